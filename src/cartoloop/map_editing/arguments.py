# SPDX-License-Identifier: Apache-2.0
"""What each kind of edit has as arguments, and how rows of a file are checked.

Submaps and nodes are numbered, and poses and places given, as in the map as mapped: they mean the
same whatever other edits are undone.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cartoloop.map_data import Edit, MapData
from cartoloop.plain_text import one_line

MAX_NUMBERS = 10_000
"""Closures or control points in one edit, at most."""

MAX_NAME = 200
"""Characters of the name of a session, at most."""

Coordinate = Annotated[float, Field(ge=-3e7, le=3e7)]
"""In metres or radians: twice as far as the coordinates that an edit is given, since the map as
mapped may lie elsewhere."""

Index = Annotated[int, Field(ge=0, lt=2**31)]
Position = tuple[Coordinate, Coordinate]
PoseOf = tuple[Coordinate, Coordinate, Coordinate]
_Information = Annotated[float, Field(ge=-1e15, le=1e15)]


class Arguments(BaseModel):
    """Arguments of an edit, as they stand in the file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def pairs_of(self) -> list[tuple[int, int]]:
        """Return the submaps and nodes that must exist, -1 for none."""
        return []


class Drop(Arguments):
    """Closures are removed from the graph: pairs of submap and node."""

    pairs: list[tuple[Index, Index]] = Field(min_length=1, max_length=MAX_NUMBERS)

    def pairs_of(self) -> list[tuple[int, int]]:
        """Return the submaps and nodes that must exist."""
        return [(submap, node) for submap, node in self.pairs]


class Add(Arguments):
    """A closure is added, as it was matched.

    Attributes
    ----------
    tf_submap_node : as measured [m, m, rad].
    information : upper triangle of the inverse covariance, submap axes.
    score, residual : of the match.
    moved : from the given pose to the match [m, rad].
    """

    submap: Index
    node: Index
    tf_submap_node: PoseOf
    information: tuple[
        _Information, _Information, _Information, _Information, _Information, _Information
    ]
    score: float = Field(ge=0, le=1)
    residual: float = Field(ge=0, le=10)
    moved: tuple[Coordinate, Coordinate]

    def pairs_of(self) -> list[tuple[int, int]]:
        """Return the submaps and nodes that must exist."""
        return [(self.submap, self.node)]


class Pin(Arguments):
    """A node or a submap is held at a pose of the map as mapped."""

    submap: Index | None = None
    node: Index | None = None
    pose: PoseOf

    def pairs_of(self) -> list[tuple[int, int]]:
        """Return the submaps and nodes that must exist."""
        if (self.submap is None) == (self.node is None):
            raise ValueError("a pin holds either a submap or a node")
        return [(_or_none(self.submap), _or_none(self.node))]


class SurveyedPoint(Arguments):
    """A place of the map, in the frame of a node, and its surveyed position."""

    node: Index
    place: Position
    surveyed: Position


class ControlPoints(Arguments):
    """The whole map moves, without a change of its shape, to surveyed points."""

    points: list[SurveyedPoint] = Field(min_length=2, max_length=MAX_NUMBERS)

    def pairs_of(self) -> list[tuple[int, int]]:
        """Return the submaps and nodes that must exist."""
        return [(_NONE, point.node) for point in self.points]


class Align(Arguments):
    """The map is turned about its origin, until it is turned by `angle` from the map as mapped."""

    angle: float = Field(ge=-7, le=7)


class ForgetTime(Arguments):
    """Scans with stamps in a span are left out, and what was made of them.

    Attributes
    ----------
    from_stamp, to_stamp : first and last stamp [s].
    scans : first scan and end of the session that it is about; None for all sessions.
    """

    from_stamp: float = Field(ge=-1e15, le=1e15)
    to_stamp: float = Field(ge=-1e15, le=1e15)
    scans: tuple[Index, Index] | None = None


class ForgetArea(Arguments):
    """What was seen in a rectangle is removed from the submaps.

    Attributes
    ----------
    corner : its lower left corner and the direction of its lower side, map as mapped.
    size : along the lower side and across [m].
    """

    corner: PoseOf
    size: tuple[Annotated[float, Field(gt=0, le=3e7)], Annotated[float, Field(gt=0, le=3e7)]]


class Split(Arguments):
    """A session is split before a scan.

    Attributes
    ----------
    scan : first of the second session.
    name : of that.
    """

    scan: Annotated[int, Field(ge=1, lt=2**31)]
    name: str = Field(min_length=1, max_length=MAX_NAME)


class Rename(Arguments):
    """A session gets another name.

    Attributes
    ----------
    scan : its first.
    name : the new one.
    """

    scan: Index
    name: str = Field(min_length=1, max_length=MAX_NAME)


KINDS: dict[str, type[Arguments]] = {
    "drop": Drop,
    "add": Add,
    "pin": Pin,
    "control_points": ControlPoints,
    "align": Align,
    "forget_time": ForgetTime,
    "forget_area": ForgetArea,
    "split": Split,
    "rename": Rename,
}
"""Arguments by the kind of an edit."""

_NONE = -1


def made(arguments: Arguments) -> Edit:
    """Return an edit with these arguments."""
    kind = next(name for name, of_kind in KINDS.items() if type(arguments) is of_kind)
    return Edit(kind, arguments.model_dump(mode="json"))


def checked(edit: Edit, original: MapData) -> Arguments:
    """Return the arguments of an edit as read from a file.

    Raises
    ------
    ValueError
        They are not of its kind, or name what the map does not have.
    """
    if edit.kind not in KINDS:
        raise ValueError(f"'{edit.kind}' is no kind of edit")
    try:
        arguments = KINDS[edit.kind].model_validate(edit.arguments)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ValueError(f"{edit.kind}: {where}: {first['msg']}") from None
    graph = original.graph
    for submap, node in arguments.pairs_of():
        if submap >= graph.num_submaps or node >= graph.num_nodes:
            raise ValueError(f"{edit.kind}: there is no submap {submap} or node {node}")
    if isinstance(arguments, ForgetTime) and arguments.scans is not None:
        begin, end = arguments.scans
        if not begin < end <= len(original.stamps):
            raise ValueError(f"{edit.kind}: there are no scans {begin} to {end}")
    if isinstance(arguments, Split | Rename):
        if arguments.scan >= max(len(original.stamps), 1):
            raise ValueError(f"{edit.kind}: there is no scan {arguments.scan}")
        if one_line(arguments.name) != arguments.name:
            raise ValueError(f"{edit.kind}: a name holds control characters")
    return arguments


def _or_none(index: int | None) -> int:
    return _NONE if index is None else index
