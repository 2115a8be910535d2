# SPDX-License-Identifier: Apache-2.0
"""An examination as JSON; docs/doctor.md explains its keys, which stay as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from cartoloop.doctor.clouds import CloudWatch
from cartoloop.doctor.contents import Stream
from cartoloop.doctor.examination import Examination, Scanner
from cartoloop.readers.ros.inventory import TransformSummary

VERSION = 1


def document(examinations: Sequence[Examination]) -> dict[str, Any]:
    """Return examinations as plain data that JSON can hold; what is not known is None."""
    plain: dict[str, Any] = _finite(
        {
            "version": VERSION,
            "can_be_mapped": all(e.can_be_mapped for e in examinations),
            "recordings": [_recording(e) for e in examinations],
        }
    )
    return plain


def _recording(examination: Examination) -> dict[str, Any]:
    return {
        "path": str(examination.path),
        "kind": examination.contents.kind,
        "can_be_mapped": examination.can_be_mapped,
        "duration_s": examination.duration,
        "num_scans": sum(scanner.watch.count for scanner in examination.scanners),
        "base_frame": examination.contents.base_frame or None,
        "streams": [_stream(stream) for stream in examination.contents.streams],
        "transforms": [_transform(t) for t in examination.contents.transforms],
        "scanners": [_scanner(scanner) for scanner in examination.scanners],
        "odometry": _odometry(examination),
        "imu": _imu(examination),
        "choices": [asdict(choice) for choice in examination.choices],
        "findings": [
            {
                "severity": f.severity,
                "code": f.code,
                "where": f.where or None,
                "message": f.message,
                "remedy": f.remedy or None,
                "count": f.count,
                "time_s": f.time,
            }
            for f in examination.findings
        ],
    }


def _stream(stream: Stream) -> dict[str, Any]:
    times = stream.times
    return {
        "name": stream.name,
        "type": stream.type,
        "role": stream.role,
        "count": stream.count,
        "used": stream.used,
        "reason": stream.reason or None,
        "frames": list(stream.frames),
        "rate_hz": times.rate if times else None,
        "first_s": times.first if times else None,
        "last_s": times.last if times else None,
        "num_gaps": times.num_gaps if times else None,
        "longest_gap_s": times.longest_gap if times else None,
    }


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
    watch, profile = scanner.watch, scanner.profile
    plain: dict[str, Any] = {
        "name": scanner.name,
        "num_scans": watch.count,
        "num_scans_with_few_returns": watch.num_poor,
        "sweep_s": watch.sweep,
        "num_beams": None,
        "field_of_view_rad": None,
        "angular_resolution_rad": None,
        "range_min_m": None,
        "range_max_m": None,
        "no_return_m": None,
        "share_no_return": None,
        "range_step_m": None,
        "range_noise_m": None,
        "rate_hz": None,
    }
    if profile is not None:
        # A scanner of which one tells "inf" is not one of which nothing is known.
        is_infinite = profile.no_return == math.inf
        plain |= {
            "num_beams": profile.num_beams,
            "field_of_view_rad": profile.field_of_view,
            "angular_resolution_rad": profile.angular_resolution,
            "range_min_m": profile.range_min,
            "range_max_m": profile.range_max,
            "no_return_m": "inf" if is_infinite else profile.no_return,
            "share_no_return": profile.share_no_return,
            "range_step_m": profile.range_quantum,
            "range_noise_m": profile.range_noise,
            "rate_hz": profile.rate,
        }
    if isinstance(watch, CloudWatch):
        return plain | {"num_points": watch.num_points}
    mounting = list(watch.geometry.tf_tracking_sensor) if watch.geometry else None
    return plain | {"mounting_m_rad": mounting, "values": asdict(watch.values)}


def _odometry(examination: Examination) -> dict[str, Any] | None:
    odometry, calibration = examination.odometry, examination.calibration
    if odometry is None:
        return None
    known = calibration is not None and calibration.model.is_known
    model = calibration.model if calibration is not None and known else None
    return {
        "count": odometry.count,
        "path_m": odometry.way,
        "turned_rad": odometry.turned,
        "max_speed_m_s": odometry.fastest,
        "max_turn_rad_s": odometry.fastest_turn,
        "num_jumps": odometry.num_jumps,
        "num_scans_tried": calibration.num_scans if calibration else 0,
        "time_offset_s": model.time_offset if model else None,
        "rotation_scale": model.rotation_scale if model else None,
        "translation_scale": model.translation_scale if model else None,
        "rotation_error_rad": model.rotation_error if model else None,
        "translation_error_m": model.translation_error if model else None,
    }


def _imu(examination: Examination) -> dict[str, Any] | None:
    imu = examination.imu
    if imu is None:
        return None
    return {
        "count": imu.count,
        "mean_acceleration_m_s2": imu.mean_size,
        "min_acceleration_m_s2": imu.lowest,
        "max_acceleration_m_s2": imu.highest,
        "tilt_rad": imu.tilt,
        "max_turn_rad_s": imu.fastest_turn,
    }


def _finite(value: Any) -> Any:  # noqa: ANN401 - anything that JSON holds
    """Return plain data with None for numbers that JSON does not know."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
