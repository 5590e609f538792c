"""A process that compiles on and on does not run out of memory maps: LLVM would end it."""

import math
import subprocess
import sys

import jax
import pytest

import jaxgear as jg
from jaxgear import _compiled
from jaxgear import _kept_programs as programs
from jaxgear._process import memory_maps, most_memory_maps

_MANY = """
import mmap
import jax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_enable_compilation_cache", False)
import jaxgear as jg
from jaxgear._process import memory_maps, most_memory_maps

gears = jg.Gear(21, 12 * jg.mm), jg.Gear(32, 12 * jg.mm)
pair = jg.GearPair(*gears, 2 * jg.mm)
# Maps that are shared stay apart, whatever lies beside them.
taken = [mmap.mmap(-1, 4096) for _ in range(int(most_memory_maps()) - memory_maps() - 300)]
for phases in range(8, 16):
    grid = jg.mesh_grid(pair, phases=phases, slices=2)
    jg.contact_lines(pair, grid).roll.block_until_ready()
print(most_memory_maps() - memory_maps())
"""


@pytest.mark.slow
@pytest.mark.skipif(not 0 < memory_maps() < most_memory_maps() < 1e6, reason="no limit of maps")
def test_a_process_of_many_programs_lives_on():
    """Eight programs of eighty to three hundred maps each where three hundred are left."""
    done = subprocess.run(
        [sys.executable, "-c", _MANY], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0.0


@pytest.fixture
def let_go(monkeypatch):
    """How often programs were let go; a process that may have 1,000 maps has `let_go.maps`."""

    class LetGo:
        times, maps, held = 0, 0, 0

        def clear(self):
            self.times += 1
            self.maps = self.held

    found = LetGo()
    monkeypatch.setattr(programs, "_TAKEN", programs._TakenMaps())
    monkeypatch.setattr(programs, "memory_maps", lambda: found.maps)
    monkeypatch.setattr(programs, "most_memory_maps", lambda: 1000.0)
    monkeypatch.setattr(programs, "forget", lambda: None)
    monkeypatch.setattr(jax, "clear_caches", found.clear)
    return found


def test_programs_are_let_go_when_three_quarters_of_the_maps_are_taken(let_go):
    for maps, times in ((750, 0), (751, 1), (750, 1), (999, 2)):
        let_go.maps = maps
        programs.make_room()
        assert let_go.times == times


def test_what_programs_do_not_hold_lets_none_go_again_and_again(let_go):
    let_go.held = 800
    for maps, times in ((801, 1), (850, 1), (950, 1), (951, 2), (950, 2)):
        let_go.maps = maps
        programs.make_room()
        assert let_go.times == times


def test_a_verb_that_takes_long_looks_for_room(let_go, monkeypatch):
    pair = jg.GearPair(jg.Gear(21, 12 * jg.mm), jg.Gear(32, 12 * jg.mm), 2 * jg.mm)
    let_go.maps = 900
    monkeypatch.setattr(_compiled, "_COMPILING", math.inf)
    jg.total_contact_ratio(pair)
    monkeypatch.setattr(_compiled, "_COMPILING", -1.0)
    jax.jit(jg.total_contact_ratio)(pair)
    assert let_go.times == 0, "Not within somebody else's program."
    jg.total_contact_ratio(pair)
    assert let_go.times == 1
