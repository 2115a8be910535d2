# SPDX-License-Identifier: Apache-2.0
"""Values that a shell can complete; each function is called with what was typed so far."""

from __future__ import annotations

from collections.abc import Iterable


def complete_key(typed: str) -> list[str]:
    """Return the parameters that ``--set`` can set."""
    from cartoloop.config import Config
    from cartoloop.config_file import flat_keys

    return _beginning_with(typed, (f"{key}=" for key in flat_keys(Config())))


def complete_layers(typed: str) -> list[str]:
    """Return the layers of a picture, after those that were typed."""
    from cartoloop.map_output.picture import LAYERS

    return _next_of(typed, LAYERS)


def complete_formats(typed: str) -> list[str]:
    """Return the formats of ``export``, after those that were typed."""
    from cartoloop.map_output.export import FORMATS

    return _next_of(typed, FORMATS)


def complete_status(typed: str) -> list[str]:
    """Return the fates of loop closures."""
    from cartoloop.global_slam.closure_status import Status

    return _beginning_with(typed, (status.text for status in Status))


def complete_echo(typed: str) -> list[str]:
    """Return the echoes of a scanner."""
    return _beginning_with(typed, ("first", "strongest"))


def complete_world(typed: str) -> list[str]:
    """Return the simulated worlds."""
    from cartoloop.simulation import WORLDS

    return _beginning_with(typed, WORLDS)


def complete_lidar(typed: str) -> list[str]:
    """Return the simulated scanners."""
    from cartoloop.simulation import LIDARS

    return _beginning_with(typed, LIDARS)


def complete_odometry_fault(typed: str) -> list[str]:
    """Return the faults of simulated odometry."""
    from cartoloop.simulation.odometry_faults import OdometryFault

    return _beginning_with(typed, (fault.value for fault in OdometryFault))


def _next_of(typed: str, names: Iterable[str]) -> list[str]:
    """Return lists with commas that go on with one more of the names."""
    before, comma, last = typed.rpartition(",")
    others = sorted(set(names) - set(before.split(",")))
    return [before + comma + name for name in _beginning_with(last, others)]


def _beginning_with(typed: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(typed)]
