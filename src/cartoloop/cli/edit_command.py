# SPDX-License-Identifier: Apache-2.0
"""``cartoloop edit``: a finished map is edited; every edit can be undone."""

from __future__ import annotations

from cartoloop.cli import edit_changes, edit_lists
from cartoloop.cli.commands import add_function, make_app
from cartoloop.cli.edit_group import LIST, EditCommand, EditGroup

edit_app = make_app(
    "Edit a finished map: loop closures, place, scans, sessions; each edit can be undone.\n\n"
    "All files in the folder follow. The map as mapped is kept; numbers of closures, nodes and "
    "submaps are those of closures.csv and nodes.csv. Without a command, the edits are listed.",
    cls=EditGroup,
)


@edit_app.callback()
def _edit() -> None:
    # Keeps each subcommand a subcommand, were it the only one.
    pass


_LOOK = (
    (LIST, edit_lists.list_command, ["cartoloop edit intel", "cartoloop edit intel list --json"]),
    (
        "closures",
        edit_lists.closures_command,
        [
            "cartoloop edit intel closures --worst 10",
            "cartoloop edit intel closures --status removed",
        ],
    ),
)
_CHANGE = (
    ("drop", edit_changes.drop_command, ["cartoloop edit intel drop 4134 1315"]),
    (
        "add",
        edit_changes.add_command,
        ["cartoloop edit intel add 3 1200 --near 4.5,-2,90 --dry-run"],
    ),
    ("pin", edit_changes.pin_command, ["cartoloop edit intel pin --node 0 --at 10,5,90"]),
    (
        "control-points",
        edit_changes.control_points_command,
        [
            "cartoloop edit intel control-points survey.txt",
            "cartoloop edit intel control-points --point 0,0=103.2,-7.5 --point 20,1=122.9,-4.1",
        ],
    ),
    ("align", edit_changes.align_command, ["cartoloop edit intel align"]),
    (
        "forget",
        edit_changes.forget_command,
        [
            "cartoloop edit intel forget --from 976052900.5 --to 976052931 --session 0",
            "cartoloop edit intel forget --area 2.5 -1 4 0.5",
        ],
    ),
    (
        "split",
        edit_changes.split_command,
        ["cartoloop edit intel split 0 --at 976052900.5 --name afternoon"],
    ),
    ("rename", edit_changes.rename_command, ["cartoloop edit intel rename 0 morning"]),
    (
        "undo",
        edit_changes.undo_command,
        ["cartoloop edit intel undo", "cartoloop edit intel undo 2"],
    ),
    ("redo", edit_changes.redo_command, ["cartoloop edit intel redo 2"]),
)

for _name, _look, _examples in _LOOK:
    add_function(edit_app, _name, _look, _examples, group="Look", cls=EditCommand)
for _name, _change, _examples in _CHANGE:
    add_function(edit_app, _name, _change, _examples, group="Change", cls=EditCommand)
