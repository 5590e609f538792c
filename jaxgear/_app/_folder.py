"""Where results go."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Folder:
    """The folder of a command's results.

    **Fields:**

    - `path`: where it is.
    - `pictures`: whether pictures are drawn, or their data written only.
    """

    path: Path
    pictures: bool = True

    def __truediv__(self, name: str) -> Path:
        return self.path / name
