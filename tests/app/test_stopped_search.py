"""A search that is stopped leaves what earlier ones have found."""

import jax.numpy as jnp
import pytest

from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear.scene._rewriting import rewritten
from jaxgear.scene._scene import ready_scene
from jaxgear.study import _optimising
from jaxgear.study._statics import Statics

_DEPTH = "flank.pinion.tip_relief.depth_um"


def _search(folder):
    """Begin the search of the accessory scene, as far as it needs no solved cycle."""
    before = object.__new__(Statics)
    object.__setattr__(before, "numbers", {"single_pair_deflection_um": jnp.asarray(10.0)})
    object.__setattr__(before, "grid", None)
    scene = ready_scene("accessory")
    _optimising.optimisation(scene, before, Folder(folder))


def _stop(*_):
    raise KeyboardInterrupt


@pytest.mark.parametrize("earlier", ["the best relief\n", None])
def test_a_stopped_search_leaves_the_folder_as_it_was(tmp_path, monkeypatch, earlier):
    good = tmp_path / "accessory.optimised.toml"
    if earlier:
        good.write_text(earlier)
    monkeypatch.setattr(_optimising, "prepared_mesh", _stop)
    with pytest.raises(KeyboardInterrupt):
        _search(tmp_path)
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == (
        {good.name: earlier} if earlier else {}
    )


def test_a_scene_that_cannot_be_rewritten_is_refused_before_the_search(tmp_path, monkeypatch):
    asked = {}

    def refuse(source, updates):
        asked.update(updates)
        raise ValueError("its tables are spread over the file")

    monkeypatch.setattr(_optimising, "prepared_mesh", _stop)
    monkeypatch.setattr(_optimising, "rewritten", refuse)
    with pytest.raises(InputError, match="its tables are spread over the file"):
        _search(tmp_path)
    # All keys that the search will set, the wheel's twins too.
    assert {_DEPTH, _DEPTH.replace("pinion", "wheel")} <= set(asked)
    assert not list(tmp_path.iterdir())


def test_a_rewritten_scene_is_text_alone(tmp_path):
    source = ready_scene("accessory").path
    text = rewritten(source, {_DEPTH: 12.5})
    assert "depth_um = 12.5" in text
    assert "depth_um = 12.5" not in source.read_text()
