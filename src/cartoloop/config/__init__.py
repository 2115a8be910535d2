# SPDX-License-Identifier: Apache-2.0
"""Every parameter: default, unit, meaning. Keys are Cartographer's where it has them.

One configuration serves all recordings. What depends on the sensor (field of view, range limits,
rate) is read off the recording by the sensor profile; ``None`` here means "as profiled".
"""

from __future__ import annotations

from cartoloop.config.finished_map import LifelongConfig, MapOutputConfig, QualityConfig
from cartoloop.config.global_slam import (
    ConstraintSearchConfig,
    GlobalSlamConfig,
    JoinConfig,
    PoseAdjustmentConfig,
    RepairConfig,
    WideSearchConfig,
)
from cartoloop.config.local_slam import (
    DeskewingConfig,
    InsertionConfig,
    LocalSlamConfig,
    MotionFilterConfig,
    PredictionConfig,
    SubmapConfig,
    WallStepConfig,
)
from cartoloop.config.scan_matching import (
    AdaptiveVoxelFilterConfig,
    CorrelativeMatcherConfig,
    LeastSquaresMatcherConfig,
)
from cartoloop.config.section import Section
from cartoloop.config.sensor import SensorConfig

__all__ = [
    "AdaptiveVoxelFilterConfig",
    "Config",
    "ConstraintSearchConfig",
    "CorrelativeMatcherConfig",
    "DeskewingConfig",
    "GlobalSlamConfig",
    "InsertionConfig",
    "JoinConfig",
    "LeastSquaresMatcherConfig",
    "LifelongConfig",
    "LocalSlamConfig",
    "MapOutputConfig",
    "MotionFilterConfig",
    "PoseAdjustmentConfig",
    "PredictionConfig",
    "QualityConfig",
    "RepairConfig",
    "Section",
    "SensorConfig",
    "SubmapConfig",
    "WallStepConfig",
    "WideSearchConfig",
]


class Config(Section):
    """All parameters."""

    sensor: SensorConfig = SensorConfig()
    local_slam: LocalSlamConfig = LocalSlamConfig()
    global_slam: GlobalSlamConfig = GlobalSlamConfig()
    map_output: MapOutputConfig = MapOutputConfig()
    quality: QualityConfig = QualityConfig()
    lifelong: LifelongConfig = LifelongConfig()
