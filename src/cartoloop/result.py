# SPDX-License-Identifier: Apache-2.0
"""A map that can be saved, composed and loaded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.arguments import as_path
from cartoloop.map_data import MapData
from cartoloop.quality.verdict import Quality

if TYPE_CHECKING:
    from cartoloop.map_editing.editor import Editor
    from cartoloop.map_output.occupancy_map import OccupancyMap


@dataclass(frozen=True, eq=False, repr=False)
class Result(MapData):
    """A finished map, or a growing one at one moment; its attributes are those of MapData."""

    def __repr__(self) -> str:
        counts = self.report.constraints
        return (
            f"<Result: {len(self.stamps)} scans, {self.graph.num_nodes} nodes, "
            f"{self.graph.num_submaps} submaps, {self.graph.num_loop_closures} loop closures "
            f"({counts.searched} pairs searched)>"
        )

    @property
    def quality(self) -> Quality:
        """The verdict on the map, as it was examined when mapping ended.

        Unknown where mapping was stopped; `examined` returns it then.
        """
        return self.report.quality

    def examined(self) -> Result:
        """Return the map with a new verdict, by the present program and its configuration."""
        from cartoloop.quality.examine import examine

        quality = examine(self, self.config.quality, self.report.extra.get("odometry"))
        return replace(self, report=replace(self.report, quality=quality))

    def occupancy_map(self) -> OccupancyMap:
        """Return the map that is exported, composed of all submaps; computed once.

        Raises
        ------
        OutputError
            The map is too large.
        """
        return self._occupancy_map

    @cached_property
    def _occupancy_map(self) -> OccupancyMap:
        from cartoloop.map_output.main_part import main_submaps
        from cartoloop.map_output.occupancy_map import compose_map

        return compose_map(*main_submaps(self), self.config.local_slam.submaps)

    def save(self, out: str | PathLike[str]) -> None:
        """Write map, trajectories, graph, configuration and report into the folder `out`.

        They replace a map that is there, of whatever recording, all at once.

        Raises
        ------
        OutputError
            The folder or a file in it cannot be written.
        """
        from cartoloop.map_output.save import save

        save(self, as_path(out, "Result.save: out"))


def load_map(path: str | PathLike[str], *, edits: bool = True) -> Result:
    """Return the map that was saved as a map database; times are not kept in it.

    Parameters
    ----------
    path : the file, or the folder that ``cartoloop map`` wrote.
    edits : whether its edits are applied; otherwise it is the map as mapped.

    Raises
    ------
    InputError
        It is not there, is no map database, is damaged, or was written by a newer program.
    """
    from cartoloop.map_file.read import read_map

    original = Result(**vars(read_map(path, _open_base)))
    if not (edits and original.edits):
        return original
    from cartoloop.map_editing.open_map import as_edited

    return as_edited(original, path)


def _open_base(path: Path) -> MapData:
    """Return the map that an interrupted run adds to."""
    from cartoloop.map_editing.open_map import open_map

    return open_map(path)


def edit(path: str | PathLike[str]) -> Editor[Result]:
    """Return an editor of a finished map; used with ``with``, it saves the map at the end.

    >>> with cartoloop.edit("intel") as editor:
    ...     editor.drop_closures(17)
    ...     editor.align()

    Parameters
    ----------
    path : the folder that ``cartoloop map`` wrote.

    Raises
    ------
    InputError
        There is no finished map, or it is damaged.
    """
    from cartoloop.map_editing.edited_folder import EditedFolder
    from cartoloop.map_editing.editor import Editor

    folder = EditedFolder.of(as_path(path, "edit: path"))
    return Editor(load_map(folder.path, edits=False), folder)
