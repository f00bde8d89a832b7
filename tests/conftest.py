"""Tests run with one thread for linear algebra (matrices are small here), one width of text, and signals that act."""

import os
import signal

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Reports are as wide as the terminal: tests see what a pipe sees.
os.environ["COLUMNS"] = "100"

# A shell starts what runs in the background with interrupts ignored, and `nohup` with hang-ups; programs that tests
# start would inherit that.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)


SAMPLED = {"conformance": 12, "long": 2}
"""Marker -> of its tests every Nth runs with ``--sampled``, in the order of collection."""


def pytest_addoption(parser):
    parser.addoption("--sampled", action="store_true", help=f"run every Nth test of a marker, N by marker: {SAMPLED}")


def pytest_collection_modifyitems(config, items):
    """Leaves out what ``--sampled`` says."""
    left_out = set()
    for name, step in SAMPLED.items() if config.getoption("--sampled") else ():
        marked = [item for item in items if item.get_closest_marker(name)]
        left_out |= {id(item) for k, item in enumerate(marked) if k % step}
    config.hook.pytest_deselected(items=[item for item in items if id(item) in left_out])
    items[:] = [item for item in items if id(item) not in left_out]


@pytest.fixture
def coarse(monkeypatch):
    """Pictures of arms of fewer points: what stands in them, and where labels go, does not depend on the grain."""
    monkeypatch.setattr("posture_opt.report.scene.shaded_picture.DPI", 40)
    monkeypatch.setattr("posture_opt.report.scene.shaded_picture.OVERSAMPLING", 1)
