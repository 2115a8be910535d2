# SPDX-License-Identifier: Apache-2.0
"""Edit a finished map: ``python examples/edit_a_map.py [MAP]``.

Without arguments, a drive through a ring of corridors is simulated and mapped first.
"""

import argparse
import sys

import cartoloop
from cartoloop.simulation import ring, simulate


def main(folder: str | None = None) -> cartoloop.Result:
    """Edit the map in a folder, and undo a part of it."""
    if folder is None:
        folder = "example-edited"
        mapper = cartoloop.Mapper()
        for event in simulate(ring(), seed=1, duration=125.0).events():
            mapper.add(event)
        mapper.finish().save(folder)

    with cartoloop.edit(folder) as editor:
        in_graph = [row for row in editor.closures() if row.is_in_graph]
        best = max(in_graph, key=lambda row: row.score or 0.0)
        print(editor.drop_closures(best.number).text)  # noqa: T201
        print(editor.add_closure(best.submap, best.node).text)  # noqa: T201
        print(editor.set_control_points([(0, 0, 100, 50), (10, 0, 100, 60)]).text)  # noqa: T201
        editor.undo()  # the control points; the closures stay as they are edited
        editor.align()

    result = cartoloop.load(folder)
    print(f"{len(result.edits)} edits: {folder}/map.png")  # noqa: T201
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Edit a map.")
    parser.add_argument("folder", nargs="?", help="folder of a map; by default one is made")
    try:
        main(**vars(parser.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
