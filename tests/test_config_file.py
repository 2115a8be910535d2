# SPDX-License-Identifier: Apache-2.0
"""Loading and writing the configuration."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib

import pytest

from cartoloop.config import Config
from cartoloop.config_file import MACHINE_PARAMETERS, config_hash, config_toml, load_config
from cartoloop.errors import ConfigError
from cartoloop.pose_adjustment import Loss


def file_of(tmp_path, text):
    path = tmp_path / "my.toml"
    path.write_text(text)
    return path


def test_nothing_given_is_the_defaults():
    loaded = load_config()

    assert loaded.config == Config()
    assert loaded.origins == {}


def test_settings_override_the_file_and_the_file_defaults(tmp_path):
    path = file_of(tmp_path, "[local_slam.submaps]\nresolution = 0.1\nnum_range_data = 30\n")

    loaded = load_config(path, ["local_slam.submaps.resolution=0.2"])

    assert loaded.config.local_slam.submaps.resolution == 0.2
    assert loaded.config.local_slam.submaps.num_range_data == 30
    assert loaded.origins == {
        "local_slam.submaps.resolution": "--set",
        "local_slam.submaps.num_range_data": "file my.toml",
    }


def test_the_rest_of_a_section_keeps_its_defaults(tmp_path):
    path = file_of(
        tmp_path, "[global_slam.constraint_search.adaptive_voxel_filter]\nmax_range = 30.0\n"
    )

    section = load_config(path).config.global_slam.constraint_search.adaptive_voxel_filter

    default = Config().global_slam.constraint_search.adaptive_voxel_filter
    assert section == default.model_copy(update={"max_range": 30.0})


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("sensor.max_range=8", 8.0),
        ("sensor.max_range= 1e1", 10.0),
        ("sensor.max_range=none", None),
        ("local_slam.use_odometry=false", False),
        ("global_slam.pose_adjustment.loss=cauchy", Loss.CAUCHY),
        ('global_slam.pose_adjustment.loss="huber"', Loss.HUBER),
        ("local_slam.submaps.num_range_data=7", 7),
    ],
)
def test_settings_are_read_by_the_type_of_their_key(setting, value):
    result = load_config(settings=[setting]).config.model_dump()
    for part in setting.partition("=")[0].split("."):
        result = result[part]

    assert result == value
    assert type(result) is type(value)


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("local_slam.submaps.resolutoin", "local_slam.submaps.resolution"),
        ("resolution", "local_slam.submaps.resolution"),
        ("TRAJECTORY_BUILDER_2D.submaps.num_range_data", "local_slam.submaps.num_range_data"),
        ("POSE_GRAPH.optimize_every_n_nodes", "global_slam.optimize_every_n_nodes"),
        ("global_slam.constraint_search.minscore", "global_slam.constraint_search.min_score"),
        ("max_constraint_distance", "global_slam.constraint_search.max_constraint_distance"),
        ("local_slam.submaps.resolution.x", "local_slam.submaps.resolution"),
    ],
)
def test_an_unknown_key_names_the_nearest(key, nearest):
    with pytest.raises(ConfigError, match=f"unknown key '{key}'; did you mean '{nearest}'"):
        load_config(settings=[f"{key}=1"])


@pytest.mark.parametrize("key", ["x", "a.b", "foo", "sensor.foo"])
def test_a_key_like_no_other_names_none(key):
    with pytest.raises(
        ConfigError, match=f"unknown key '{key}'; 'cartoloop config show' lists all"
    ):
        load_config(settings=[f"{key}=1"])


def test_an_unknown_key_of_a_file_is_named_with_its_line(tmp_path):
    path = file_of(tmp_path, "[local_slam.submaps]\nnum_range_data = 1\nresolutoin = 0.1\n")

    with pytest.raises(ConfigError, match=r"my\.toml:3: unknown key"):
        load_config(path)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            "local_slam.submaps.resolution=-1",
            r"resolution = -1 \(--set\): must be greater than or equal to 0\.001.*\[m\]",
        ),
        ("local_slam.submaps.resolution=coarse", r"must be a valid number"),
        ("local_slam.submaps.resolution=inf", r"must be a finite number"),
        ("local_slam.submaps.resolution=nan", r"must be a finite number"),
        ("local_slam.submaps.resolution=[1]", r"must be a valid number"),
        ("local_slam.submaps.num_range_data=1.5", r"must be a valid integer"),
        ("global_slam.pose_adjustment.loss=l2", r"must be 'none', 'huber', 'cauchy'"),
        ("local_slam.submaps=5", r"is a section"),
        ("local_slam.submaps.resolution", r"expected key=value"),
        ("=5", r"unknown key ''"),
    ],
)
def test_an_invalid_value_is_reported_with_its_limits(setting, message):
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(settings=[setting])

    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[local_slam\nx = 1", "is not valid TOML.*line 1"),
        (b"\xff\xfe\x00", "is no text; expected TOML"),
        (b"x = " + 5000 * b"1", "is not valid TOML"),
        (b"x = " + 5000 * b"[", "is nested too deeply"),
    ],
)
def test_a_file_that_is_no_toml_is_a_config_error(tmp_path, content, message):
    path = tmp_path / "my.toml"
    path.write_bytes(content)

    with pytest.raises(ConfigError, match=message):
        load_config(path)


def test_a_missing_file_is_a_config_error(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        load_config(tmp_path / "none.toml")


@pytest.mark.parametrize(
    "settings",
    [
        [],
        [
            "sensor.max_range=8.5",
            "local_slam.submaps.resolution=0.1",
            "local_slam.use_odometry=false",
        ],
    ],
)
def test_written_toml_reads_back_unchanged(tmp_path, settings):
    loaded = load_config(settings=settings)

    text = config_toml(loaded.config, loaded.origins)

    tomllib.loads(text)
    assert load_config(file_of(tmp_path, text)).config == loaded.config


def test_toml_states_meaning_unit_and_origin():
    loaded = load_config(settings=["local_slam.submaps.resolution=0.1"])

    lines = config_toml(loaded.config, loaded.origins).splitlines()

    given = next(line for line in lines if line.startswith("resolution = "))
    assert given.startswith("resolution = 0.1 ")
    assert "[m]" in given
    assert given.endswith("(--set)")
    assert next(line for line in lines if line.startswith("max_time_seconds")).endswith("(default)")
    assert any(line.startswith("# max_range = none") for line in lines)


def test_without_origins_changed_values_are_marked():
    config = load_config(settings=["local_slam.submaps.resolution=0.1"]).config

    text = config_toml(config, without=MACHINE_PARAMETERS)

    assert text.count("(set)") == 1
    assert "num_threads" not in text


def test_hash_depends_on_parameters_of_the_result():
    default = config_hash(Config())

    assert config_hash(load_config(settings=["global_slam.num_threads=3"]).config) == default
    assert config_hash(load_config(settings=["sensor.max_range=3"]).config) != default


def test_every_parameter_has_a_description():
    for line in config_toml(Config()).splitlines():
        assert "None" not in line


def test_a_pose_survives_writing_and_reading(tmp_path):
    written = tmp_path / "config.toml"
    given = load_config(settings=["sensor.laser_pose=[-0.04, 0, 0.1]"]).config
    written.write_text(config_toml(given))

    assert given.sensor.laser_pose == (-0.04, 0.0, 0.1)
    assert load_config(written).config == given


@pytest.mark.parametrize("level", ["1", "2"])
def test_nothing_is_left_out_without_docstrings(level):
    code = "from cartoloop.config_file import *; print(config_toml(Config()), end='')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONOPTIMIZE": level},
        capture_output=True,
        text=True,
        check=True,
    )

    assert done.stdout == config_toml(Config())
