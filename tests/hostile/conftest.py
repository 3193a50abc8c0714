"""Files are tried in a process of their own, as users have it."""

import pytest

from fit.telemetry import sandbox

rejections = sandbox.rejections


@pytest.fixture(autouse=True)
def files_in_another_process(monkeypatch):
    monkeypatch.setattr(sandbox, "rejections", rejections)
