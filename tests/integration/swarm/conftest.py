"""Labs of the tests' own, as the tests of the lab have them."""

from tests.integration.lab.conftest import ctl, labs_folder, nothing_remains

__all__ = ["ctl", "labs_folder", "nothing_remains"]
