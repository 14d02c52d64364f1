"""A file of each test."""

import pytest


@pytest.fixture
def file(tmp_path):
    """Write a file and return its path as text."""

    def write(*parts: str) -> str:
        path = tmp_path / "study.toml"
        path.write_text("".join(parts))
        return str(path)

    return write
