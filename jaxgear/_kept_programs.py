"""Programs of commands that are kept as JAX has lowered them: found again, they are not traced.

JAX's own cache of compiled programs is asked only once a function has been traced and lowered,
which takes longer than all that a command computes. Here a program is found by what it is made
from: the function's name, the source of our packages, the versions of theirs, the structure of the
arguments with all that is no array in it, and the shapes. Numbers are arguments, so that they are
in no key; a function that closes over some has no name to be found by, and is not kept. What is
kept is `jax.export`'s portable form: to compile it stays with JAX and its cache, in whose folder
it is.
"""

import contextlib
import dataclasses
import functools
import hashlib
import io
import os
import pickle
import threading
from collections.abc import Callable, Generator, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxgear._lowered_files import lowered_folder, read_lowered, surroundings, write_lowered
from jaxgear._process import memory_maps, most_memory_maps


class Program(NamedTuple):
    """A compiled function of the leaves of its arguments.

    **Fields:**

    - `compiled`: from leaves to leaves.
    - `result`: the structure of what it returns.
    """

    compiled: Callable[..., Any]
    result: Any

    def __call__(self, *leaves: Any) -> Any:
        """What the function returns."""
        return jax.tree.unflatten(self.result, self.compiled(*leaves))


class Kind(NamedTuple):
    """What a program knows of an array that it is given.

    **Fields:**

    - `shape`: of the array.
    - `dtype`: of its elements.
    """

    shape: tuple[int, ...]
    dtype: np.dtype


# XLA takes fusions through MLIR for half of its time; its plain emitter does as well here.
_PLAIN = ("xla_cpu_use_fusion_emitters", False)
# For programs that run a few times: a third of the time to compile, a few times as long to run.
# Without the optimiser there is too little to do to split it among threads.
QUICKLY = (
    ("xla_backend_optimization_level", 0),
    ("xla_llvm_disable_expensive_passes", True),
    ("xla_cpu_parallel_codegen_split_count", 1),
    _PLAIN,
)
# For programs that run often: half of the time to compile, for those who run as fast.
USUALLY = (("xla_backend_optimization_level", 1), _PLAIN)

Options = tuple[tuple[str, Any], ...]


def called(function: Callable[..., Any], *arguments: Any, options: Options = QUICKLY) -> Any:
    """What a function of a module, compiled, returns for numbers and arrays.

    **Arguments:**

    - `function`: to be called; all that it uses is in its arguments.
    - `arguments`: pytrees of numbers and arrays.
    - `options`: for the compiler.
    """
    leaves, structure = leaves_of(*arguments)
    return program_of(function, structure, kinds_of(leaves), options)(*leaves)


_KEEPS: ContextVar[bool] = ContextVar("_KEEPS", default=False)


@contextlib.contextmanager
def keeping_verbs() -> Generator[None]:
    """Programs of verbs that take long to trace are kept too, for all that runs inside."""
    token = _KEEPS.set(True)
    try:
        yield
    finally:
        _KEEPS.reset(token)


def keeps_verbs() -> bool:
    """Whether programs of verbs are kept where this is asked."""
    return _KEEPS.get() and lowered_folder() is not None


@dataclasses.dataclass(frozen=True)
class _Verb:
    """A verb with those of its arguments that are no arrays.

    **Fields:**

    - `named`: by whose name it is found again.
    - `settings`: leaves of the arguments, `None` for each array, and their structure.
    - `body`: what is traced; not kept.
    """

    named: Callable[..., Any]
    settings: tuple[tuple[Any, ...], Any]
    body: Callable[..., Any] | None = dataclasses.field(compare=False)

    @property
    def arguments(self) -> Any:
        """The arguments, arrays left out."""
        return jax.tree.unflatten(self.settings[1], self.settings[0])

    @property
    def structure(self) -> Any:
        """That of the arrays."""
        are_arrays = [True if x is None else None for x in self.settings[0]]
        return jax.tree.structure((jax.tree.unflatten(self.settings[1], are_arrays),))

    def __call__(self, arrays: Any) -> Any:
        assert self.body is not None
        args, kwargs = eqx.combine(arrays, self.arguments)
        return self.body(*args, **kwargs)

    def __reduce__(self) -> tuple[Any, ...]:
        # It is written to be told from others: structures cannot be, but what is built like them.
        return tuple, ((self.named, self.arguments),)


_NUMBERS = jax.Array, np.ndarray, np.generic


def verb_called(
    named: Callable[..., Any],
    body: Callable[..., Any],
    args: tuple,
    kwargs: dict[str, Any],
    options: Options,
) -> Any:
    """Call a verb whose program is kept, with concrete arrays.

    **Arguments:**

    - `named`: what its module calls by the name of the verb.
    - `body`: the function itself.
    - `args`, `kwargs`: of the verb; what is no array is a part of the program.
    - `options`: for the compiler.

    **Returns:**

    What the verb returns.
    """
    leaves, shape = jax.tree.flatten((args, kwargs))
    arrays = [x for x in leaves if isinstance(x, _NUMBERS)]
    others = tuple(None if isinstance(x, _NUMBERS) else x for x in leaves)
    verb = _Verb(named, (others, shape), body)
    return program_of(verb, None, kinds_of(arrays), options)(*arrays)


def leaves_of(*arguments: Any) -> tuple[list[Any], Any]:
    """Arrays and structure of arguments; plain numbers become arrays.

    **Arguments:**

    - `arguments`: pytrees of numbers and arrays.

    **Returns:**

    Leaves and structure.
    """
    leaves, structure = jax.tree.flatten(arguments)
    return [x if isinstance(x, jax.Array) else np.asarray(x) for x in leaves], structure


def kinds_of(leaves: Sequence[Any]) -> tuple[Kind, ...]:
    """What programs know of arrays."""
    return tuple(Kind(x.shape, x.dtype) for x in leaves)


def program_of(
    function: Callable[..., Any], structure: Any, kinds: tuple[Kind, ...], options: Options
) -> Program:
    """A compiled function, lowered anew only where it has not been kept.

    **Arguments:**

    - `function`: to be compiled; one that is kept stands by a name in its module.
    - `structure`: of its arguments; of a verb `None`, which knows its own.
    - `kinds`: of the leaves of its arguments.
    - `options`: for the compiler.

    **Returns:**

    The function of such leaves.
    """
    if is_named(function):
        asked = function, structure, kinds, options
        # Of two threads that ask at once, one waits for what the other compiles.
        with _BEING_MADE.setdefault(asked, threading.RLock()):
            return _named_program(*asked)
    return _program(function, structure, kinds, options)


def _program(
    function: Callable[..., Any], structure: Any, kinds: tuple[Kind, ...], options: Options
) -> Program:
    """A program that is not kept as it was lowered."""
    flat, results = _flat(function, structure)
    lowered = jax.jit(flat).lower(*_arrays(kinds))
    return Program(_compiled(lowered, options), results[-1])


def _compiled(lowered: jax.stages.Lowered, options: Options) -> jax.stages.Compiled:
    make_room()
    # What the environment says to XLA it says for these programs too.
    options = tuple(
        each for each in options if f"--{each[0]}=" not in os.environ.get("XLA_FLAGS", "")
    )
    try:
        return lowered.compile(compiler_options=dict(options))
    except jax.errors.JaxRuntimeError as error:
        # Options come and go with versions of XLA, and save time only.
        known = tuple(each for each in options if f"option: '{each[0]}'" not in str(error))
        if known == options:
            raise
        return _compiled(lowered, known)


def is_named(function: Any) -> bool:
    """Whether a function stands by a name in its module, and so closes over nothing."""
    return isinstance(function, _Verb) or "<" not in function.__qualname__


def _name(function: Any) -> str:
    return (function.named if isinstance(function, _Verb) else function).__name__


def forget() -> None:
    """Let go of the programs of this process."""
    _named_program.cache_clear()
    _BEING_MADE.clear()


_BEING_MADE: dict[tuple[Any, ...], threading.RLock] = {}


@dataclasses.dataclass
class _TakenMaps:
    """Memory maps that were left when all programs had been let go."""

    maps: int = 0


_TAKEN = _TakenMaps()


def make_room() -> None:
    """Let go of all that is compiled once three quarters of the process's memory maps are taken.

    XLA maps each kernel of a program by itself, some thousand for a mesh cycle. Linux allows 65,530
    (`vm.max_map_count`), and LLVM ends a process that asks for more: no error that could be caught.
    What is let go and is called again is compiled again.
    """
    free = most_memory_maps() - _TAKEN.maps
    if memory_maps() - _TAKEN.maps > 0.75 * free:
        forget()
        jax.clear_caches()
        _TAKEN.maps = memory_maps()


# More than the programs of any one command.
@functools.lru_cache(maxsize=128)
def _named_program(
    function: Callable[..., Any], structure: Any, kinds: tuple[Kind, ...], options: Options
) -> Program:
    # A sweep calls verbs a thousand times: what it takes to find one again is all it takes then.
    structure = function.structure if isinstance(function, _Verb) else structure
    path = _path(function, structure, kinds)
    kept = None if path is None else read_lowered(path)
    if kept is None:
        flat, results = _flat(function, structure)
        try:
            kept = jax.export.export(jax.jit(flat))(*_arrays(kinds)), results[-1]
        except ValueError:
            # On some devices an operation has no portable form. A user's mistake is told again.
            return _program(function, structure, kinds, options)
        if path is not None:
            write_lowered(path, *kept)
    return _imported(*kept, kinds, options, _name(function))


def _imported(
    exported: jax.export.Exported, result: Any, kinds: tuple[Kind, ...], options: Options, name: str
) -> Program:
    def flat(*leaves: Any) -> Any:
        return exported.call(*leaves)

    flat.__name__ = flat.__qualname__ = name
    lowered = jax.jit(flat).lower(*_arrays(kinds))
    return Program(_compiled(lowered, options), result)


def _arrays(kinds: tuple[Kind, ...]) -> list[jax.ShapeDtypeStruct]:
    return [jax.ShapeDtypeStruct(*kind) for kind in kinds]


def _flat(function: Callable[..., Any], structure: Any) -> tuple[Callable[..., Any], list[Any]]:
    """A function from leaves to leaves, and where it leaves the structure of its result."""
    results: list[Any] = []

    def flat(*leaves: Any) -> list[Any]:
        found, result = jax.tree.flatten(function(*jax.tree.unflatten(structure, leaves)))
        results.append(result)
        return found

    # The name under which compilers and profilers report it.
    flat.__name__ = flat.__qualname__ = _name(function)
    return flat, results


def _path(function: Callable[..., Any], structure: Any, kinds: tuple[Kind, ...]) -> Path | None:
    """Where a program is kept; None where none is, or where it cannot be told from others."""
    folder = lowered_folder()
    if folder is None:
        return None
    content = io.BytesIO()
    pickler = pickle.Pickler(content, protocol=5)
    # Without its memory of objects what is equal is written alike, be it one object or two.
    pickler.fast = True
    try:
        pickler.dump((function, jax.tree.unflatten(structure, range(len(kinds))), kinds))
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    key = hashlib.sha256(content.getvalue() + surroundings().encode()).hexdigest()
    # Ends as the files of JAX's cache do, with which it is counted and removed.
    return folder / f"lowered_{_name(function)}-{key}-cache"
