"""What holds for any value of any key: a few examples, and ten thousand by `-m slow`."""

import math
import re
from pathlib import Path

import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jaxgear.scene._key import Key, show
from jaxgear.scene._rewriting import write_scene
from jaxgear.scene._scene import READY, SceneError, example_scene, read_scene
from jaxgear.scene._schema import KEYS

_ANY = st.recursive(
    st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats()
    | st.text(st.characters(codec="utf-8", exclude_characters="\x00"), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abc", min_size=1), inner),
    max_leaves=4,
)
# The same examples in every run, and no limit of time: the machine may be busy.
_FEW = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
_MANY = settings(_FEW, max_examples=10_000)


def _likely(key: Key) -> st.SearchStrategy[object]:
    """Values of the right type, most of them within the bounds or at them."""
    if key.kind == "bool":
        return st.booleans()
    if key.kind in ("text", "texts"):
        one = st.sampled_from(key.choices or ("a", "wheel.body", "pinion.profile_shift"))
        return one if key.kind == "text" else st.lists(one, min_size=1, max_size=3)
    low = next((x for x in (key.above, key.at_least) if x is not None), None)
    high = next((x for x in (key.below, key.at_most) if x is not None), None)
    if key.kind == "int":
        least = None if low is None else math.ceil(low)
        return st.integers(least, None if high is None else math.floor(high))
    number = st.floats(low, high, allow_nan=False, allow_infinity=False)
    if key.kind == "float":
        return number
    return st.lists(number, min_size=key.length or 0, max_size=key.length or 4)


def _value(path: str) -> st.SearchStrategy[tuple[str, object]]:
    return (_likely(KEYS[path]) | _likely(KEYS[path]) | _ANY).map(lambda value: (path, value))


_KEY_AND_VALUE = st.sampled_from(sorted(KEYS)).flatmap(_value)


def _fits(key: Key, value: object) -> bool:
    """Whether the table of keys allows a value, by its words."""
    if key.kind in ("floats", "texts"):
        if not isinstance(value, list) or not value or key.length not in (None, len(value)):
            return False
        return all(_fits_one(key, entry) for entry in value)
    return _fits_one(key, value)


def _fits_one(key: Key, value: object) -> bool:
    if key.kind in ("bool", "text", "texts"):
        if not isinstance(value, bool if key.kind == "bool" else str):
            return False
        allowed = not key.choices or value in key.choices
        return allowed and (not key.pattern or bool(re.fullmatch(key.pattern, str(value))))
    if isinstance(value, bool) or not isinstance(value, int if key.kind == "int" else int | float):
        return False
    return (
        math.isfinite(value)
        and (key.above is None or value > key.above)
        and (key.at_least is None or value >= key.at_least)
        and (key.below is None or value < key.below)
        and (key.at_most is None or value <= key.at_most)
    )


def _a_key_takes_what_it_allows(drawn: tuple[str, object]) -> None:
    path, value = drawn
    key = KEYS[path]
    if _fits(key, value):
        assert key.read(value) == value
    else:
        with pytest.raises(
            ValueError, match=re.escape(f"got {show(value)}, must be {key.allowed}")
        ):
            key.read(value)


def _a_scene_is_read_or_refused(name: str, drawn: list[tuple[str, object]], folder: Path) -> None:
    """What is read is written and read again as it was; what is refused is named."""
    changes = [
        f"{path.replace('[]', '[0]')}={tomlkit.item(value).as_string()}" for path, value in drawn
    ]
    try:
        scene = example_scene(name, changes)
    except SceneError as error:
        mistakes = error.mistakes
    else:
        path = folder / "scene.toml"
        write_scene(scene, path)
        assert read_scene(path).values == scene.values
        return
    assert mistakes
    assert all(mistake.message and mistake.where for mistake in mistakes)


_SCENES = st.sampled_from(sorted(path.stem for path in READY.glob("*.toml")))
_CHANGES = st.lists(_KEY_AND_VALUE, min_size=1, max_size=3)


@_FEW
@given(_KEY_AND_VALUE)
def test_a_key_takes_what_it_allows(drawn):
    _a_key_takes_what_it_allows(drawn)


@_FEW
@given(_SCENES, _CHANGES)
def test_a_scene_is_read_or_refused(tmp_path_factory, name, drawn):
    _a_scene_is_read_or_refused(name, drawn, tmp_path_factory.getbasetemp())


@pytest.mark.slow
@_MANY
@given(_KEY_AND_VALUE)
def test_every_key_takes_what_it_allows(drawn):
    _a_key_takes_what_it_allows(drawn)


@pytest.mark.slow
@_MANY
@given(_SCENES, _CHANGES)
def test_every_scene_is_read_or_refused(tmp_path_factory, name, drawn):
    _a_scene_is_read_or_refused(name, drawn, tmp_path_factory.getbasetemp())
