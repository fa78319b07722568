"""The commands are tested with the parts and the file of the settings tests."""

from tests.daemon.config.conftest import _fake_parts, cell_file, real_parts

__all__ = ["_fake_parts", "cell_file", "real_parts"]
