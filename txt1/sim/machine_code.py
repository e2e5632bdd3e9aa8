"""Machine code of loops over numbers and arrays, by numba, which is loaded with the first of them."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from runpy import run_path
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast

import numpy as np


def compiled(
    function: Callable[..., Any],
    *,
    reorder: bool = False,
    calls: Mapping[str, Any] | None = None,
    cache: bool = False,
    **options: Any,
) -> Callable[..., Any]:
    """Return the function, compiled if numba is installed, and scipy, whose linear algebra numba calls.

    Args:
        function: function of numbers and arrays.
        reorder: whether sums and products may be reordered, which vector instructions need; NaN and infinity keep their
            meaning.
        calls: compiled functions, by the names used in its code.
        cache: whether the machine code is kept on the disk, where that is possible.
        options: options of numba.njit.

    """
    try:
        from numba import njit
    except ImportError:
        return function
    # without it numba ends the whole process at the first system of equations
    if find_spec("scipy") is None:
        return function
    # mypyc has compiled it; numba needs its Python source, which lies beside it
    if not isinstance(function, FunctionType):
        module = function.__module__
        source = Path(__file__).parents[2].joinpath(*module.split(".")).with_suffix(".py")
        function = run_path(str(source))[function.__name__]
        # numba imports the module when it loads kept machine code
        function.__module__ = module
    if calls or cache:
        known = {**function.__globals__, **(calls or {}), "__name__": function.__module__}
        function = FunctionType(function.__code__, known, function.__name__, function.__defaults__)
    liberties = {"contract", "reassoc", "nsz", "arcp"} if reorder else False
    made = partial(njit, error_model="numpy", fastmath=liberties, **options)
    if cache:
        # numba looks for changes in the function's own file only
        function.__qualname__ += f"-{_digest(function)}"
        with suppress(OSError, RuntimeError):  # there is no folder for machine code
            return cast("Callable[..., Any]", made(function, cache=True))
    return cast("Callable[..., Any]", made(function))


def _digest(function: Any) -> str:
    """Return what tells a compiled function from others of its name: its code, the functions that it calls, and the
    constants that it reads, in whatever file they are.
    """
    function = getattr(function, "py_func", function)
    code, known = function.__code__, function.__globals__
    parts = [code.co_code, *(repr(each).encode() for each in code.co_consts if not isinstance(each, CodeType))]
    modules = [known[name] for name in code.co_names if isinstance(known.get(name), ModuleType)]
    for name in code.co_names:
        for read in (known.get(name), *(getattr(module, name, None) for module in modules)):
            if hasattr(read, "py_func"):
                parts.append(_digest(read).encode())
            elif isinstance(read, int | float | str | tuple):
                parts.append(repr(read).encode())
            elif isinstance(read, np.ndarray):
                parts.append(read.tobytes())
    return sha256(b"\0".join(parts)).hexdigest()[:16]
