"""Programs of commands: how many there are, that numbers are no part of them, that they last."""

import concurrent.futures
import os
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from made_programs import made_programs

from jaxgear import _kept_programs as programs
from jaxgear._cli._commands import COMMANDS
from jaxgear._cli._folder import Folder
from jaxgear._compiled import lasting
from jaxgear.scene._scene import example_scene

# --- Commands
from jaxgear.study._running import timed

# Few phases and slices, and quick teeth: they change no number of programs.
_COARSE = ("mesh.phases=8", "mesh.slices=4", "map.depth_um.points=5", "map.extent.points=3")
_COARSE += ("mesh.stiffness=iso6336",)
_OTHER = (
    "pair.torque_pinion_Nm=100",
    "mesh.smoothing_um=0.2",
    "flank.pinion.tip_relief.depth_um=3",
    "flank.wheel.tip_relief.depth_um=3",
    "material.young_GPa=210",
    "wheel.shaft.gear_at_mm=41",
)


# Most of them are single operations, but for about one of each picture and each stage.
@pytest.mark.slow
@pytest.mark.end_to_end
@pytest.mark.parametrize(("command", "most"), [("modes", 19), ("run", 22), ("map", 22)])
def test_a_command_is_a_few_programs_and_with_other_numbers_none(command, most, tmp_path):
    folder = Folder(tmp_path, pictures=False)
    run = lambda *changes: COMMANDS[command](
        example_scene("accessory", (*_COARSE, *changes)), folder
    )
    jax.clear_caches()
    programs.forget()
    with made_programs() as whole:
        first = run()
    with made_programs() as again:
        second = run(*_OTHER)
    assert 3 <= len(whole) <= most, "\n".join(whole)
    assert again == []
    assert second["static"]["te_rms_um"] != first["static"]["te_rms_um"]


# --- Programs that are kept


class _Line(eqx.Module):
    """A straight line, of slope so many times its own number."""

    slope: Array
    times: int = eqx.field(static=True)


_TRACED: list[int] = []


def _on_line(line: _Line, x: Array) -> dict[str, tuple[Array, _Line]]:
    _TRACED.append(line.times)
    return {"y": (line.times * line.slope * x, line)}


@pytest.fixture
def kept_in(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(programs, "lowered_folder", lambda: tmp_path)
    programs.forget()
    _TRACED.clear()
    return tmp_path


def _asked(slope: float = 2.0, times: int = 3, x: tuple[float, ...] = (1.0, 4.0)) -> list[float]:
    """Call it as a later process would: nothing is known but what is in the folder."""
    programs.forget()
    line = _Line(jnp.asarray(slope), times)
    y, same = programs.called(_on_line, line, np.asarray(x))["y"]
    assert isinstance(same, _Line)
    assert same.times == times
    return y.tolist()


def test_a_program_that_was_kept_is_not_traced_and_gives_the_same(kept_in):
    assert _asked() == [6.0, 24.0]
    assert _asked() == [6.0, 24.0]
    assert _TRACED == [3]
    (file,) = kept_in.iterdir()
    assert file.stat().st_mode & 0o077 == 0, "nobody else's to write to"


def test_another_number_is_the_same_program_another_setting_or_shape_is_another(kept_in):
    _asked()
    assert _asked(slope=-5.0) == [-15.0, -60.0]
    assert _TRACED == [3]
    assert _asked(times=2) == [4.0, 16.0]
    assert _asked(x=(1.0, 2.0, 3.0)) == [6.0, 12.0, 18.0]
    assert _TRACED == [3, 2, 3]
    assert len(list(kept_in.iterdir())) == 3


def _slowly_traced(x: Array) -> Array:
    _TRACED.append(0)
    # Long enough that another thread asks meanwhile.
    time.sleep(0.2)
    return 2.0 * x


def test_two_threads_that_ask_at_once_make_one_program(kept_in):
    with concurrent.futures.ThreadPoolExecutor(2) as threads:
        ask = lambda x: float(programs.called(_slowly_traced, x))
        assert list(threads.map(ask, [1.0, 3.0])) == [2.0, 6.0]
    assert len(_TRACED) == 1
    assert len(list(kept_in.iterdir())) == 1


def test_another_version_of_the_source_is_another_program(kept_in, monkeypatch):
    _asked()
    monkeypatch.setattr(programs, "surroundings", lambda: "another version")
    assert _asked() == [6.0, 24.0]
    assert _TRACED == [3, 3]


@pytest.mark.parametrize("damage", [lambda x: b"", lambda x: x[:-7], lambda x: x[:40] + b"?" * 99])
def test_a_damaged_file_is_replaced(kept_in, damage):
    _asked()
    (file,) = kept_in.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert _asked() == [6.0, 24.0]
    assert _TRACED == [3, 3]
    assert _asked() == [6.0, 24.0]
    assert _TRACED == [3, 3], "kept whole the second time"


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="POSIX only")
def test_a_folder_that_is_not_there_costs_time_only(kept_in, monkeypatch):
    monkeypatch.setattr(programs, "lowered_folder", lambda: kept_in / "nowhere")
    assert _asked() == [6.0, 24.0]
    assert not list(kept_in.iterdir())


def test_a_function_that_closes_over_numbers_is_never_kept_nor_taken_for_another(kept_in):
    found = [float(timed(lambda x, by=by: by * x, np.asarray(2.0))) for by in (3.0, 5.0)]
    assert found == [6.0, 10.0]
    assert not list(kept_in.iterdir())


def test_what_has_no_portable_form_is_compiled_as_it_is(kept_in, monkeypatch):
    def refused(*arguments, **options):
        raise ValueError("custom calls without compatibility guarantees")

    monkeypatch.setattr(jax.export, "export", refused)
    assert _asked() == [6.0, 24.0]
    assert not list(kept_in.iterdir())


def test_an_option_that_a_compiler_does_not_have_is_left_out(monkeypatch):
    monkeypatch.delenv("XLA_FLAGS")
    unknown = (("xla_of_another_version", True), *programs.QUICKLY)
    assert programs.called(jnp.sin, 0.0, options=unknown) == 0.0
    with pytest.raises(jax.errors.JaxRuntimeError, match="xla_backend_optimization_level"):
        programs.called(jnp.sin, 0.0, options=(("xla_backend_optimization_level", "much"),))


def test_an_option_that_the_environment_has_is_left_to_it(monkeypatch):
    told = []
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=0")
    compile_ = jax.stages.Lowered.compile
    monkeypatch.setattr(
        jax.stages.Lowered,
        "compile",
        lambda self, compiler_options: told.append(compiler_options) or compile_(self),
    )
    programs.forget()
    assert programs.called(jnp.sin, 0.0, options=programs.USUALLY) == 0.0
    assert told == [{"xla_cpu_use_fusion_emitters": False}]


# --- Verbs whose programs are kept


@lasting
def _multiplied(line: _Line, x: Array, *, extra: int = 0) -> Array:
    _TRACED.append(line.times)
    return line.times * line.slope * x + extra


def _called(slope: float = 2.0, times: int = 3, extra: int = 0) -> list[float]:
    """Call it as a later process would."""
    programs.forget()
    jax.clear_caches()
    return _multiplied(
        _Line(jnp.asarray(slope), times), jnp.asarray([1.0, 4.0]), extra=extra
    ).tolist()


def test_a_lasting_verb_is_kept_in_a_study_and_nowhere_else(kept_in):
    assert _called() == [6.0, 24.0]
    assert not list(kept_in.iterdir())
    with programs.keeping_verbs():
        assert [_called(), _called(), _called(slope=-1.0)] == [[6.0, 24.0]] * 2 + [[-3.0, -12.0]]
        assert _TRACED == [3, 3]
        assert _called(extra=1) == [7.0, 25.0]
        assert _called(times=2) == [4.0, 16.0]
        assert _TRACED == [3, 3, 3, 2]
    assert len(list(kept_in.iterdir())) == 3


def test_a_lasting_verb_has_derivatives_in_a_study(kept_in):
    with programs.keeping_verbs():
        of_slope = lambda slope: _multiplied(_Line(slope, 3), jnp.asarray(4.0))
        assert float(jax.grad(of_slope)(jnp.asarray(2.0))) == 12.0
    assert not list(kept_in.iterdir())
