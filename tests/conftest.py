"""The tests of the whole tool: what they share, and the count of those that need the folder of foreign data.

That folder lies beside the project (`../shared/data`). Tests marked `data` run where it exists and say so where it does
not. With LACUNA_REQUIRE_DATA set (scripts/check does it) a run fails if the folder exists and not all of them ran.
"""

import os
import signal

import pytest

import tool

ran, expected = 0, 0


def pytest_configure(config):
    config.addinivalue_line("markers", "data: needs the folder ../shared/data")


def pytest_collection_modifyitems(items):
    global expected
    for item in items:
        if item.get_closest_marker("data"):
            expected += 1
            if not tool.DATA.is_dir():
                item.add_marker(pytest.mark.skip(reason="no ../shared/data beside the project"))


def pytest_runtest_logreport(report):
    global ran
    if report.when == "call" and "data" in report.keywords and not report.skipped:
        ran += 1


def pytest_terminal_summary(terminalreporter):
    terminalreporter.write_line(f"tests on ../shared/data: {ran} of {expected} ran")


def pytest_sessionfinish(session, exitstatus):
    required = os.environ.get("LACUNA_REQUIRE_DATA") and tool.DATA.is_dir()
    if required and exitstatus == 0 and (ran == 0 or ran != expected):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_sessionstart():
    # What a shell runs in the background ignores interrupts, and so would all that the tests start.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if not os.access(tool.LACUNA, os.X_OK):
        pytest.exit(f"no lacuna at {tool.LACUNA}: run 'cargo build --release', or set LACUNA to a binary", returncode=2)
