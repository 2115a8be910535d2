# SPDX-License-Identifier: Apache-2.0
"""Add a recording to a map: ``python examples/continue_a_map.py MAP LOG [OUT]``."""

import argparse
import sys

import cartoloop


def main(onto: str, log: str, out: str = "example-continued") -> cartoloop.Result:
    """Add the recording `log` to the map `onto`, and save both in the folder `out`."""
    mapper = cartoloop.Mapper(onto=onto)
    for event in cartoloop.read(log):
        mapper.add(event)
    result = mapper.finish()
    result.save(out)
    where = "found its place" if result.sessions[-1].part == 0 else "is apart"
    print(f"session {len(result.sessions)} {where}: {out}")  # noqa: T201
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Add a recording to a map.")
    parser.add_argument("onto", help="folder of the map")
    parser.add_argument("log", help="recording")
    parser.add_argument("out", nargs="?", default="example-continued", help="folder for the map")
    try:
        main(**vars(parser.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
