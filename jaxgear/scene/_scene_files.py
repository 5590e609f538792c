"""The files that a scene names, which are relative to the scene's own folder."""

import os
from pathlib import Path

from jaxgear.scene._scene import Scene

# How the keys end that name a file.
_ENDINGS = (
    "_csv",
    ".grid",
    *(f".superelement{part}" for part in ("", "_mass", "_nodes", "_faces")),
)


def files_of(scene: Scene) -> dict[str, Path]:
    """The files that a scene names, under their keys."""
    named = {key: value for key, value in scene.fixed.items() if key.endswith(_ENDINGS)}
    return {
        key: scene.path.parent / value
        for key, value in named.items()
        if isinstance(value, str) and value
    }


def files_seen_from(scene: Scene, folder: Path) -> dict[str, str]:
    """What the keys of a scene's files must say in a scene that lies in another folder."""
    return {
        key: str(path) if Path(scene.fixed[key]).is_absolute() else os.path.relpath(path, folder)
        for key, path in files_of(scene).items()
    }
