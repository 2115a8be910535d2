# SPDX-License-Identifier: Apache-2.0
"""An examination as JSON; docs/doctor.md explains its keys, which stay as they are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from cartoloop.doctor.clouds import CloudWatch
from cartoloop.doctor.contents import Stream
from cartoloop.doctor.examination import Examination, Scanner
from cartoloop.doctor.findings import Finding
from cartoloop.readers.ros.inventory import TransformSummary

VERSION = 1
"""Version of the document; it changes when a key changes its meaning."""

_TIMES = {
    "rate_hz": "rate",
    "first_s": "first",
    "last_s": "last",
    "num_gaps": "num_gaps",
    "longest_gap_s": "longest_gap",
}
_PROFILE = {
    "num_beams": "num_beams",
    "field_of_view_rad": "field_of_view",
    "angular_resolution_rad": "angular_resolution",
    "range_min_m": "range_min",
    "range_max_m": "range_max",
    "no_return_m": "no_return",
    "share_no_return": "share_no_return",
    "range_step_m": "range_quantum",
    "range_noise_m": "range_noise",
    "rate_hz": "rate",
}
_ODOMETRY = {
    "count": "count",
    "path_m": "path_length",
    "turned_rad": "turned",
    "max_speed_m_s": "fastest",
    "max_turn_rad_s": "fastest_turn",
    "num_jumps": "num_jumps",
}
_MODEL = {
    "time_offset_s": "time_offset",
    "rotation_scale": "rotation_scale",
    "translation_scale": "translation_scale",
    "veer_rad_per_m": "veer_by_name",
    "rotation_error_rad": "rotation_error",
    "translation_error_m": "translation_error",
}
_IMU = {
    "count": "count",
    "mean_acceleration_m_s2": "mean_size",
    "min_acceleration_m_s2": "lowest",
    "max_acceleration_m_s2": "highest",
    "tilt_rad": "tilt",
    "max_turn_rad_s": "fastest_turn",
}
"""Keys of the document, and the attributes that they show."""


def document(examinations: Sequence[Examination]) -> dict[str, Any]:
    """Return examinations as plain data that JSON can hold; unknown values are None."""
    plain: dict[str, Any] = _finite(
        {
            "version": VERSION,
            "can_be_mapped": all(e.can_be_mapped for e in examinations),
            "recordings": [_recording(e) for e in examinations],
        }
    )
    return plain


def _recording(examination: Examination) -> dict[str, Any]:
    contents = examination.contents
    return {
        "path": str(examination.path),
        "kind": contents.kind,
        "can_be_mapped": examination.can_be_mapped,
        "duration_s": examination.duration,
        "num_scans": sum(scanner.watch.count for scanner in examination.scanners),
        "base_frame": contents.base_frame or None,
        "streams": [_stream(stream) for stream in contents.streams],
        "transforms": [_transform(transform) for transform in contents.transforms],
        "scanners": [_scanner(scanner) for scanner in examination.scanners],
        "odometry": _odometry(examination),
        "imu": None if examination.imu is None else _values(examination.imu, _IMU),
        "choices": [asdict(choice) for choice in examination.choices],
        "findings": [_finding(finding) for finding in examination.findings],
    }


def _finding(finding: Finding) -> dict[str, Any]:
    plain = asdict(finding)
    plain["time_s"] = plain.pop("time")
    return plain | {"where": finding.where or None, "remedy": finding.remedy or None}


def _stream(stream: Stream) -> dict[str, Any]:
    plain = asdict(stream)
    del plain["times"]
    plain |= {"reason": stream.reason or None, "frames": list(stream.frames)}
    return plain | _values(stream.times, _TIMES)


def _transform(transform: TransformSummary) -> dict[str, Any]:
    return {
        "parent": transform.parent,
        "child": transform.child,
        "origin": transform.origin,
        "translation_m": [transform.x, transform.y, transform.z],
        "roll_pitch_yaw_rad": [transform.roll, transform.pitch, transform.yaw],
        "count": transform.count,
        "moved_m": transform.moved_m,
        "moved_rad": transform.moved_rad,
    }


def _scanner(scanner: Scanner) -> dict[str, Any]:
    watch = scanner.watch
    plain: dict[str, Any] = {
        "name": scanner.name,
        "num_scans": watch.count,
        "num_scans_with_few_returns": watch.num_poor,
        "sweep_s": watch.sweep,
        **_values(scanner.profile, _PROFILE),
    }
    if plain["no_return_m"] == math.inf:
        plain["no_return_m"] = "inf"  # is known, unlike None
    if isinstance(watch, CloudWatch):
        return plain | {"num_points": watch.num_points}
    mounting = list(watch.geometry.tf_tracking_sensor) if watch.geometry else None
    return plain | {"mounting_m_rad": mounting, "values": asdict(watch.values)}


def _odometry(examination: Examination) -> dict[str, Any] | None:
    odometry, calibration = examination.odometry, examination.calibration
    if odometry is None:
        return None
    is_known = calibration is not None and calibration.model.is_known
    return {
        **_values(odometry, _ODOMETRY),
        "num_scans_tried": calibration.num_scans if calibration else 0,
        **_values(calibration.model if calibration and is_known else None, _MODEL),
    }


def _values(source: object, attributes: Mapping[str, str]) -> dict[str, Any]:
    """Return attributes by key; None for all if there is no source."""
    return {
        key: None if source is None else getattr(source, name) for key, name in attributes.items()
    }


def _finite(value: Any) -> Any:  # noqa: ANN401 - anything that JSON holds
    """Return plain data with None for numbers that JSON cannot represent."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
