"""Fixtures for every test."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, however long one takes on a loaded machine.
settings.register_profile("xfrustum", derandomize=True, deadline=None)
settings.load_profile("xfrustum")

CHECKOUT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of test data beside the checkout; tests that need it skip where it is not there."""
    folder = CHECKOUT.parent / "shared"
    if not folder.is_dir():
        pytest.skip("needs ../shared, the folder of test data beside the checkout, which is not here")
    return folder
