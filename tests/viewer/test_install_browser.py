# SPDX-License-Identifier: Apache-2.0
"""The test command installs a browser where it can, and never fails of it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.limits import LIMIT_S

SCRIPT = Path(__file__).parent / "install_browser.sh"
NEEDED = ("sh", "env", "mktemp", "rm", "tail", "timeout", "chmod", "true")


@pytest.fixture
def install(tmp_path):
    """Run the script where there are only these programs, given as shell scripts by name."""

    def install(**programs):
        folder = tmp_path / "bin"
        folder.mkdir()
        for name in NEEDED:
            (folder / name).symlink_to(shutil.which(name))
        for name, text in programs.items():
            program = folder / name.replace("_", "-")
            program.write_text(f"#!{shutil.which('sh')}\n{text}\n")
            program.chmod(0o755)
        done = subprocess.run(
            [shutil.which("sh"), SCRIPT],
            env={"PATH": str(folder), "FOLDER": str(folder), "TMPDIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=False,
            timeout=LIMIT_S,
        )
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        assert [path.name for path in tmp_path.iterdir()] == ["bin"]
        return done.stdout

    return install


APT = """
for last; do :; done
case "$*" in
    *update*) {update} ;;
    *install*) {install} ;;
esac
"""
PUT = 'printf "" >"$FOLDER/chromium"; chmod +x "$FOLDER/chromium"'
FAIL = "echo 'E: no network' >&2; exit 100"


def apt(update=":", install=PUT):
    return APT.format(update=update, install=install)


def test_nothing_is_done_where_there_is_a_browser(install):
    assert install(google_chrome="exit 1") == ""


def test_root_installs_it(install):
    output = install(id="echo 0", apt_get=apt())
    assert output == "installing chromium fonts-dejavu-core, for the tests of the viewer's page\n"


def test_sudo_without_a_password_installs_it(install):
    output = install(id="echo 1000", sudo='shift; exec "$@"', apt_get=apt())
    assert output.startswith("installing") and "skipped" not in output


def test_old_lists_of_packages_may_do(install):
    output = install(id="echo 0", apt_get=apt(update=FAIL))
    assert "apt-get update failed: E: no network" in output
    assert "skipped" not in output


@pytest.mark.parametrize(
    ("programs", "why"),
    [
        ({"id": "echo 0"}, "there is no apt-get; install Chromium by hand"),
        ({"id": "echo 1000", "apt_get": apt()}, "only root may install it: apt-get install"),
        ({"id": "echo 1000", "sudo": "exit 1", "apt_get": apt()}, "only root may install it"),
        ({"id": "echo 0", "apt_get": apt(install=FAIL)}, "failed: E: no network"),
        ({"id": "echo 0", "apt_get": apt(install=":")}, "there is none of: chromium"),
    ],
)
def test_reason_is_given_where_it_cannot_be_installed(install, programs, why):
    output = install(**programs)
    assert why in output
    assert output.endswith("; the tests of the viewer's page are skipped\n")
