# SPDX-License-Identifier: Apache-2.0
import pkgutil
from itertools import islice

import pytest

import cartoloop.kernels
from bench import graph_kernels, kernels
from cartoloop.errors import ConfigError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def workloads():
    return list(kernels.workloads())


def test_every_module_of_kernels_is_measured(workloads):
    modules = {module.name for module in pkgutil.iter_modules(cartoloop.kernels.__path__)}
    measured = {module for workload in workloads for module in workload.modules}
    assert measured == modules


def test_every_workload_can_be_chosen_by_name(workloads):
    assert {workload.kernel for workload in workloads} == set(kernels.KERNELS)


def test_no_two_workloads_have_the_same_case(workloads):
    cases = [(workload.kernel, *sorted(workload.case.items())) for workload in workloads]
    assert len(set(cases)) == len(cases)


def test_workloads_can_be_called_repeatedly(workloads):
    for workload in islice(workloads, 20):
        workload.call()
        workload.call()
        assert workload.items > 0


def test_only_the_named_kernels_are_timed():
    record = kernels.run(2, ["residuals"])
    assert {row.case["kernel"] for row in record.rows} == {"residuals"}
    assert len(record.rows) == len(graph_kernels.GRAPHS)
    for row in record.rows:
        assert 0.0 < row.figures["call"].value < 1e3
        assert row.figures["item"].unit == "ns"


def test_unknown_kernels_are_refused():
    with pytest.raises(ConfigError, match="no kernel 'matsch' to measure; the nearest is 'match'"):
        kernels.run(1, ["matsch"])
