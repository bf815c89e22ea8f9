"""Modules that a command loads at their first use: the stand-ins answer as the real ones."""

import inspect
import platform
import subprocess
import sys
from functools import partial, wraps

from hypothesis import given
from hypothesis import strategies as st

from swarmctl.commandline import late_modules


@given(st.text(alphabet=" \t\nab\u2003", max_size=40))
def test_indentation_is_removed_as_by_inspect(text: str) -> None:
    assert late_modules.cleandoc(text) == inspect.cleandoc(text)


async def _waits() -> None: ...


class _Methods:
    async def waits(self) -> None: ...

    def returns(self) -> None: ...


def test_functions_are_recognised_as_by_inspect() -> None:
    methods = _Methods()
    for value in (_waits, partial(_waits), methods.waits, partial(methods.waits), methods.returns, len, 3):
        assert late_modules.iscoroutinefunction(value) == inspect.iscoroutinefunction(value)
        assert late_modules.isfunction(value) == inspect.isfunction(value)


def test_decorated_functions_are_unwrapped() -> None:
    decorated = wraps(_waits)(lambda: None)
    assert late_modules.unwrap(decorated) is inspect.unwrap(decorated) is _waits
    assert late_modules.unwrap(decorated, stop=callable) is decorated


def test_the_operating_system_has_its_name() -> None:
    assert late_modules.system() == platform.system()


def test_other_names_load_the_real_module() -> None:
    code = (
        "import sys\n"
        "from swarmctl.commandline.late_modules import late_modules\n"
        "with late_modules():\n"
        "    import click, inspect, uuid\n"
        "assert 'ast' not in sys.modules\n"
        "assert click.UUID('0' * 31 + '7') == uuid.UUID(int=7)\n"
        "print(inspect.signature(lambda one: one), sys.modules['inspect'] is not inspect)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "(one) True\n"


def test_help_and_lists_load_no_compiler() -> None:
    code = (
        "import atexit, sys; sys.argv = ['swarmctl', 'node', '--help']\n"
        "from swarmctl.__main__ import program\n"
        "heavy = ('ast', 'dis', 'uuid', 'shutil')\n"
        "loaded = lambda name: hasattr(sys.modules.get(name), '__file__')\n"
        "atexit.register(lambda: print(*filter(loaded, heavy)))\n"
        "program()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""
