"""Where programs are kept as JAX has lowered them, and what they depend on besides their arguments.

They lie in the folder of JAX's own cache of what is compiled, whose files are counted and removed
together.
"""

import contextlib
import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import pickle
from pathlib import Path
from typing import Any

import jax

from jaxgear._whole_file import whole_file

_OURS = ("jaxgear", "optimise", "fem_prep")
_THEIRS = ("jax", "jaxlib", "equinox", "diffrax", "lineax", "optimistix", "optax", "numpy", "scipy")

# JAX gives no types for its settings.
_CONFIG: Any = jax.config


def lowered_folder() -> Path | None:
    """The folder of JAX's cache, if it is to be used."""
    found = _CONFIG.jax_compilation_cache_dir
    return Path(found) if _CONFIG.jax_enable_compilation_cache and found else None


@functools.cache
def surroundings() -> str:
    """All that a lowered program depends on besides its function and arguments."""
    source = hashlib.sha256()
    for name in _OURS:
        found = importlib.util.find_spec(name)
        for root in () if found is None else found.submodule_search_locations or ():
            for file in sorted(Path(root).rglob("*.py")):
                source.update(f"{name}/{file.relative_to(root)}\n".encode() + file.read_bytes())
    versions = [importlib.metadata.version(name) for name in _THEIRS]
    settings = [f"{key}={os.environ[key]}" for key in sorted(os.environ) if key[:4] == "JAX_"]
    backend, x64 = jax.default_backend(), str(_CONFIG.jax_enable_x64)
    settings = [each for each in settings if "CACHE" not in each]
    return "\n".join([source.hexdigest(), *versions, *settings, backend, x64])


def read_lowered(path: Path) -> tuple[jax.export.Exported, Any] | None:
    """A kept program and the structure of its result; None if it is not there, or is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    whole = hashlib.sha256(content[32:]).digest() == content[:32]
    if not whole:
        with contextlib.suppress(OSError):
            path.unlink()
        return None
    exported, example = pickle.loads(content[32:])
    return jax.export.deserialize(bytearray(exported)), jax.tree.structure(example)


def write_lowered(path: Path, exported: jax.export.Exported, result: Any) -> None:
    """Keep a program; where that cannot be, nothing is lost but time."""
    # Structures cannot be written, but what is built like it can.
    example = jax.tree.unflatten(result, range(result.num_leaves))
    with contextlib.suppress(OSError, pickle.PicklingError, AttributeError, TypeError):
        body = pickle.dumps((bytes(exported.serialize()), example), protocol=5)
        with whole_file(path) as draft:
            # It is unpickled: nobody else may write to it.
            draft.touch(mode=0o600)
            draft.write_bytes(hashlib.sha256(body).digest() + body)
