"""The tests of the whole tool: what they share, and the count of those that need the folder of foreign data.

The tool under test is that of the profile `checked`, unless LACUNA names another.

The folder of data lies beside the project (`../shared/data`). Tests marked `data` run where it exists and say so where it
does not. With LACUNA_REQUIRE_DATA set (scripts/check does it) a run fails if the folder exists and not all of them ran.
With `-n` the counts are those of all processes.
"""

import os
import pathlib
import signal
import sys

import pytest

os.environ.setdefault("LACUNA", str(pathlib.Path(__file__).resolve().parent.parent / "target" / "checked" / "lacuna"))

import tool  # noqa: E402, it looks for the binary

ran, expected = 0, 0


def is_worker(config):
    """Whether this process runs a part of the tests for another one."""
    return hasattr(config, "workerinput")


def pytest_configure(config):
    config.addinivalue_line("markers", "data: needs the folder ../shared/data")


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Where other processes run the tests, each of them has collected them all."""
    global expected
    expected = max(expected, getattr(node, "workeroutput", {}).get("expected", 0))


def pytest_collection_modifyitems(config, items):
    global expected
    for item in items:
        if item.get_closest_marker("data"):
            expected += 1
            if not tool.DATA.is_dir():
                item.add_marker(pytest.mark.skip(reason="no ../shared/data beside the project"))
    if is_worker(config):
        config.workeroutput["expected"] = expected


def pytest_runtest_logreport(report):
    global ran
    if report.when == "call" and "data" in report.keywords and not report.skipped:
        ran += 1


def pytest_terminal_summary(terminalreporter):
    terminalreporter.write_line(f"tests on ../shared/data: {ran} of {expected} ran")


def pytest_sessionfinish(session, exitstatus):
    required = os.environ.get("LACUNA_REQUIRE_DATA") and tool.DATA.is_dir() and not is_worker(session.config)
    if required and exitstatus == 0 and (ran == 0 or ran != expected):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_sessionstart():
    # What a shell runs in the background ignores these, and so would all that the tests start.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)
    if not os.access(tool.LACUNA, os.X_OK):
        pytest.exit(f"no lacuna at {tool.LACUNA}: run 'cargo build --profile checked', or set LACUNA to a binary", returncode=2)


@pytest.fixture(scope="session")
def renderer_scenes():
    """What the scenes of samples/renderers need besides their text."""
    result = tool.run([sys.executable, tool.SAMPLES / "renderers" / "make.py"])
    assert result.status == 0, result
