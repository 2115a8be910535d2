# SPDX-License-Identifier: Apache-2.0
"""Requests that pages may send; others are refused. See ``docs/viewer-protocol.md``."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from cartoloop.viewer.playback import MAX_SPEED, MIN_SPEED

MAX_REQUEST_BYTES = 1000

MAX_COORDINATE_M = 1e5
"""Poses farther from the origin of the map are refused [m]."""

Number = Annotated[int, Field(ge=0, lt=2**53)]

Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-math.tau, le=math.tau, allow_inf_nan=False)]


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Play(_Request):
    """Go on."""

    type: Literal["play"]


class Pause(_Request):
    """Stop where it is."""

    type: Literal["pause"]


class Speed(_Request):
    """Map at a multiple of the pace of the recording, or as fast as possible."""

    type: Literal["speed"]
    value: Annotated[float, Field(ge=MIN_SPEED, le=MAX_SPEED, allow_inf_nan=False)] | None


class ClosureDetails(_Request):
    """Ask for the details of a loop closure, by its row."""

    type: Literal["closure"]
    id: Number
    constraint: Number


class AllClosures(_Request):
    """List the loop closures with what the record holds of them."""

    type: Literal["closures"]
    id: Number


class Before(_Request):
    """Send the poses before loop closure."""

    type: Literal["before"]
    id: Number


class NodeScan(_Request):
    """Send the points of a node."""

    type: Literal["node_scan"]
    id: Number
    node: Number


class DropClosure(_Request):
    """Remove a loop closure from the map."""

    type: Literal["drop_closure"]
    id: Number
    submap: Number
    node: Number


class UndoEdit(_Request):
    """Undo an edit of the map."""

    type: Literal["undo_edit"]
    id: Number
    edit: Number


class RedoEdit(_Request):
    """Put an edit that was undone in force again."""

    type: Literal["redo_edit"]
    id: Number
    edit: Number


class SetPose(_Request):
    """Try a pose of the robot in the map: x, y [m], theta [rad]."""

    type: Literal["set_pose"]
    id: Number
    pose: tuple[Coordinate, Coordinate, Angle]


class Picture(_Request):
    """Send the map as a PNG file."""

    type: Literal["picture"]
    id: Number


class Ping(_Request):
    """Answer."""

    type: Literal["ping"]
    id: Number


Query = ClosureDetails | AllClosures | Before | NodeScan | Picture
"""Requests that are looked up in the state."""

EditRequest = DropClosure | UndoEdit | RedoEdit
"""Requests that change the map and its files."""

Request = Play | Pause | Speed | Query | EditRequest | SetPose | Ping

_ANY: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="type")])


class BadRequestError(Exception):
    """A page has sent an invalid request; the connection must be closed."""


def parse_request(text: str) -> Request:
    """Return the request that a page has sent.

    Raises
    ------
    BadRequestError
        It is none.
    """
    try:
        return _ANY.validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        raise BadRequestError(fault["msg"]) from error
