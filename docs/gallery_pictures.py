"""Small copies of the gallery's pictures of example scenes: `python docs/gallery_pictures.py`.

It takes the folders of results of the commands that the gallery names, and skips what is not there.
"""

import argparse
from pathlib import Path

from PIL import Image

_WIDTH = 1000  # pixels
_PICTURES = {
    "gear_pair": "accessory",
    "before_after": "accessory",
    "flank_maps": "accessory",
    "modification": "accessory",
    "sweep": "accessory",
    "waterfall": "accessory",
    "shafts": "accessory",
    "master_curve_traced": "accessory/map",
    "robust": "accessory/optimise",
    "tornado": "accessory/optimise",
    "campbell_wheel": "accessory-h1/modes",
    "wheel_waves": "accessory-h1/sweep",
}


def main() -> None:
    """Copy each picture that is there, in at most 256 colours."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("results", type=Path, nargs="?", default=Path("results"))
    results = parser.parse_args().results
    for name, folder in _PICTURES.items():
        source = results / folder / f"{name}.png"
        if not source.exists():
            print(f"{source} is not there: its picture stays as it is.")
            continue
        picture = Image.open(source).convert("RGB")
        height = round(picture.height * _WIDTH / picture.width)
        small = picture.resize((_WIDTH, height), Image.Resampling.LANCZOS)
        small.quantize(64).save(Path(__file__).parent / "pictures" / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
