"""A search that is stopped goes on from what it has found."""

import jax.numpy as jnp
import numpy as np
import pytest

import optimise
from jaxgear._checks import InputError
from jaxgear.scene._build import model_of
from jaxgear.scene._rewriting import rewritten
from jaxgear.scene._scene import example_scene
from jaxgear.study import _optimising
from jaxgear.study._built import BuiltScene
from jaxgear.study._design import design_space
from jaxgear.study._search import by_gradient, forget, record_file
from jaxgear.study._statics import Statics

_DEPTH = "flank.pinion.tip_relief.depth_um"


def _space(*settings):
    scene = example_scene("accessory", ("mesh.stiffness=iso6336", *settings))
    return design_space(BuiltScene(scene), (_DEPTH,), symmetric=True, deflection=10.0)


@pytest.mark.parametrize("widths", [(), ("optimise.anneal_um=[2.0, 1.0]",)])
def test_a_search_goes_on_from_its_record_and_forgets_it_when_it_has_ended(tmp_path, widths):
    space = _space(*widths)
    file = record_file(space, tmp_path)
    (tmp_path / "search-0123.jsonl").write_text("of another scene\n")
    bowl = lambda x, width: (jnp.sum((x - 7.0) ** 2), 2.0 * (x - 7.0))
    stopped_at = []

    def watched(limit):
        def evaluate(x, width):
            if len(stopped_at) == limit:
                raise KeyboardInterrupt
            stopped_at.append(np.asarray(x))
            return bowl(x, width)

        return by_gradient(
            space, optimise.ValueAndGradient(evaluate), optimise.Batched(jnp.asarray), file
        )

    with pytest.raises(KeyboardInterrupt):
        watched(2).descend(space.start, lambda point, value: None)
    assert len(list(tmp_path.iterdir())) == 2
    found = watched(-1).descend(space.start, lambda point, value: None)
    assert found.point[0] == pytest.approx(7.0, abs=1e-4)
    # What was known was not evaluated again.
    assert len(stopped_at) < found.evaluations + 2
    assert not any(np.array_equal(x, stopped_at[0]) for x in stopped_at[2:] if not widths)
    forget(file)
    assert [each.name for each in tmp_path.iterdir()] == ["search-0123.jsonl"]


def test_a_scene_that_cannot_be_rewritten_is_refused_before_the_search(tmp_path, monkeypatch):
    asked = {}

    def refuse(source, updates):
        asked.update(updates)
        raise ValueError("its tables are spread over the file")

    scene = example_scene("accessory", ("mesh.stiffness=iso6336",))
    before = object.__new__(Statics)
    object.__setattr__(before, "numbers", {"single_pair_deflection_um": jnp.asarray(10.0)})
    object.__setattr__(before, "model", model_of(scene))
    object.__setattr__(before, "influences", None)
    monkeypatch.setattr(_optimising, "rewritten", refuse)
    with pytest.raises(InputError, match="its tables are spread over the file"):
        _optimising.optimisation(BuiltScene(scene), before, memory=tmp_path)
    # All keys that the search will set, the wheel's twins too.
    assert {_DEPTH, _DEPTH.replace("pinion", "wheel")} <= set(asked)
    assert not list(tmp_path.iterdir())


def test_a_rewritten_scene_is_text_alone(tmp_path):
    source = example_scene("accessory").path
    text = rewritten(source, {_DEPTH: 12.5})
    assert "depth_um = 12.5" in text
    assert "depth_um = 12.5" not in source.read_text()
