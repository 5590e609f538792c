import builtins
import io
import json
import math
import os
import resource
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import quick

import jaxgear._cli as cli_package
from jaxgear.__main__ import main as door
from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear._cli._printing import print_summary
from jaxgear.scene._json_schema import SCHEMA_LINE
from jaxgear.scene._scene import READY, read_scene
from jaxgear.study._statics import SolverFailure

_SUMMARY = {
    "name": "accessory",
    "versions": {"jax": "1.2.3"},
    "geometry": {"centre_distance_mm": 99.450283},
    "static": {"te_rms_um": 2.36, "speeds": list(range(300)), "bearings": [{"index": 0}]},
}


@pytest.fixture
def commands(monkeypatch):
    """Commands that compute nothing; a test may replace one. Notes every call."""
    stub: Any = types.ModuleType("jaxgear._cli._commands")
    calls = []

    def noted(name):
        def command(scene, folder):
            calls.append((name, scene, folder, jnp.asarray(0.5).dtype))
            return _SUMMARY

        return command

    stub.COMMANDS = {name: noted(name) for name in ("run", "map", "optimise", "check-grad")}
    stub.calls = calls
    monkeypatch.setitem(sys.modules, stub.__name__, stub)
    monkeypatch.setattr(cli_package, "_commands", stub, raising=False)
    return stub


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The example scene `accessory` in an empty current folder."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", "accessory", "--quiet"]) == 0
    return Path("accessory.toml")


def _raise(error):
    def command(scene, folder):
        raise error

    return command


@pytest.mark.parametrize("name", ["accessory", "accessory-h1", "power"])
def test_init_writes_a_scene_that_reads(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    assert main(["init", name]) == 0
    ready = READY / f"{name}.toml"
    assert Path(f"{name}.toml").read_text() == SCHEMA_LINE + ready.read_text()
    cite = str(read_scene(f"{name}.toml").value("cite"))
    assert cite.startswith("Guilbert 2017, Tab. III-")
    assert cite in capsys.readouterr().out


def test_init_does_not_overwrite_unless_forced(scene, capsys):
    scene.write_text("mine")
    assert main(["init", "accessory"]) == 2
    assert "exists already. Use --force" in capsys.readouterr().err
    assert scene.read_text() == "mine"
    assert main(["init", "accessory", "--force"]) == 0
    assert read_scene(scene).value("pinion.teeth") == 45


def test_init_of_an_unknown_name_lists_the_ready_ones(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "acessory"]) == 2
    error = capsys.readouterr().err
    assert "accessory-h1, accessory-h2, industrial, power, power-h1, power-h2" in error
    assert "Did you mean accessory?" in error
    assert not list(tmp_path.iterdir())


def test_init_takes_changes_and_a_folder(tmp_path, capsys):
    arguments = ["--set", "pair.torque_pinion_Nm=120", "--out", str(tmp_path / "new"), "--json"]
    assert main(["init", "power", *arguments]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["cite"] == "Guilbert 2017, Tab. III-5"
    assert read_scene(answer["scene"]).value("pair.torque_pinion_Nm") == 120.0
    assert "about 310 N m" in Path(answer["scene"]).read_text()


@pytest.mark.parametrize("command", ["run", "map", "optimise", "check-grad"])
def test_a_command_gets_the_scene_the_folder_and_64_bits(scene, commands, command, capsys):
    assert main([command, str(scene), "--set", "mesh.slices=3"]) == 0
    ((name, given, folder, precision),) = commands.calls
    assert name == command
    assert given.mesh.slices == 3
    own = Path("results/accessory") / ("" if command == "run" else command)
    assert folder.path == own
    assert own.is_dir()
    assert folder.kept("memo") == Path("results/accessory/memo")
    assert folder.pictures
    assert precision == "float64"
    output = capsys.readouterr()
    assert "centre_distance_mm (a_w)  99.4503" in output.out
    assert output.err == f"results in {own}\n"
    assert "results" not in output.out


def test_out_names_the_folder(scene, commands):
    assert main(["run", str(scene), "--out", "a/b"]) == 0
    assert main(["map", str(scene), "--out", "a/b"]) == 0
    assert [folder.path for _, _, folder, *_ in commands.calls] == [Path("a/b"), Path("a/b/map")]
    assert not Path("results").exists()


def test_pictures_can_be_left_out(scene, commands):
    assert main(["run", str(scene), "--no-pictures"]) == 0
    assert not commands.calls[0][2].pictures


def test_json_is_all_there_is_on_standard_output(scene, commands, capsys):
    commands.COMMANDS["run"] = lambda *_: {"a": np.arange(2), "b": np.float64(0.5), "c": 1}
    assert main(["run", str(scene), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"a": [0, 1], "b": 0.5, "c": 1}


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_json_never_holds_what_is_not_a_number(scene, commands, capsys, value):
    commands.COMMANDS["run"] = lambda *_: {"a": value}
    assert main(["run", str(scene), "--json"]) == 1
    output = capsys.readouterr()
    assert output.out == ""
    assert "not a finite number" in output.err


def test_quiet_prints_nothing_but_the_json_asked_for(scene, commands, capsys):
    assert main(["run", str(scene), "--quiet"]) == 0
    output = capsys.readouterr()
    assert (output.out, output.err) == ("", "")
    assert main(["run", str(scene), "--quiet", "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out) == _SUMMARY
    assert output.err == ""


def test_a_bad_scene_is_refused_before_anything_else(scene, commands, capsys):
    scene.write_text(scene.read_text().replace("teeth = 45", "tooth = 45"))
    assert main(["run", str(scene), "--set", "pair.tork=5"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert "accessory.toml:27: pinion.tooth: unknown key, got 45, did you mean pinion.teeth?" in (
        output.err
    )
    assert "--set pair.tork=5: pair.tork: unknown key" in output.err
    assert "3 mistakes; nothing was computed." in output.err
    assert not commands.calls
    assert not Path("results").exists()


def test_a_missing_scene_is_refused(tmp_path, commands, capsys):
    assert main(["run", str(tmp_path / "none.toml")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_an_impossible_gear_is_exit_code_2(scene, commands, capsys):
    commands.COMMANDS["run"] = _raise(InputError("The tooth is pointed."))
    assert main(["run", str(scene)]) == 2
    assert capsys.readouterr().err == "jaxgear: accessory.toml: The tooth is pointed.\n"


def test_a_solver_failure_is_exit_code_1(scene, commands, capsys):
    commands.COMMANDS["run"] = _raise(SolverFailure("No contact at phase 3."))
    assert main(["run", str(scene)]) == 1
    assert capsys.readouterr().err == "jaxgear: accessory.toml: No contact at phase 3.\n"


def test_a_full_disk_is_exit_code_1(scene, commands, capsys):
    commands.COMMANDS["run"] = _raise(OSError(28, "No space left on device"))
    assert main(["run", str(scene)]) == 1
    assert "cannot write results into results/accessory" in capsys.readouterr().err


def test_a_fault_of_ours_is_not_dressed_up(scene, commands):
    commands.COMMANDS["run"] = _raise(TypeError("ours"))
    with pytest.raises(TypeError, match="ours"):
        main(["run", str(scene)])


def test_an_interruption_is_one_line_and_130(scene, commands, capsys):
    commands.COMMANDS["run"] = _raise(KeyboardInterrupt())
    assert main(["run", str(scene)]) == 130
    assert capsys.readouterr().err == "jaxgear: interrupted\n"


class _Swallows:
    """Raises where Python cannot: what it raises is only reported."""

    def __init__(self, error):
        self.error = error

    def __del__(self):
        raise self.error


@pytest.mark.parametrize(("error", "count"), [(KeyboardInterrupt(), 1), (ValueError(), 0)])
def test_an_interruption_that_a_callback_swallows_comes_again(
    scene, commands, monkeypatch, error, count
):
    again, reported = [], []
    monkeypatch.setattr("_thread.interrupt_main", lambda: again.append(True))
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: reported.append(lost.exc_type))

    def command(*_):
        _Swallows(error)
        raise OSError("enough")

    commands.COMMANDS["run"] = command
    assert main(["run", str(scene)]) == 1
    assert len(again) == count
    assert len(reported) == 1 - count


@pytest.mark.parametrize("out", ["file", "file/below"])
def test_a_folder_that_cannot_be_written_is_refused_first(scene, commands, capsys, out):
    Path("file").write_text("")
    assert main(["run", str(scene), "--out", out]) == 2
    error = capsys.readouterr().err
    assert f"cannot write results into {out}" in error
    assert "--out DIR" in error
    assert not commands.calls


def test_a_full_disk_is_found_before_the_work(scene, commands, capsys):
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, usual[1]))
    try:
        assert main(["run", str(scene)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    error = capsys.readouterr().err
    assert "cannot write results into results/accessory: File too large" in error
    assert not commands.calls


@pytest.mark.parametrize("option", ["--set", "--out"])
def test_bytes_that_are_no_text_are_refused_first(scene, commands, capsys, option):
    assert main(["run", str(scene), option, "name=\udcff"]) == 2
    assert "must be text in UTF-8, got name=\\udcff" in capsys.readouterr().err
    assert not commands.calls


def test_what_a_terminal_cannot_show_is_spelled_out(scene, commands, monkeypatch):
    commands.COMMANDS["run"] = lambda *_: {"largest": "3 µm"}
    shown = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(shown, encoding="ascii"))
    assert main(["run", str(scene)]) == 0
    assert shown.getvalue() == b"largest  3 \\xb5m\n"


# A stream with a buffer fails when it is flushed, one without at the first word.
@pytest.mark.parametrize("buffer", ["", "1"])
@pytest.mark.parametrize(
    "arguments", quick(2, [["init", "accessory"], ["--help"], ["keys"], ["--version"]])
)
def test_standard_output_without_space_is_one_line_and_1(tmp_path, arguments, buffer):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "jaxgear", *arguments],
            cwd=tmp_path,
            env=os.environ | {"PYTHONUNBUFFERED": buffer},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr == ("jaxgear: cannot write to standard output: No space left on device\n")


def test_without_standard_output_nothing_is_lost(scene, commands, monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["run", str(scene)]) == 0
    sys.stdout.close()
    assert len(commands.calls) == 1


def test_an_interruption_of_the_imports_is_one_line_and_130(monkeypatch, capsys):
    def interrupted(name, *given):
        if name.startswith("jaxgear._cli"):
            raise KeyboardInterrupt
        return usual(name, *given)

    usual = builtins.__import__
    monkeypatch.setattr(builtins, "__import__", interrupted)
    assert door() == 130
    assert capsys.readouterr().err == "jaxgear: interrupted\n"


def test_run_checks_its_sweep_and_the_others_leave_it_aside(scene, commands, capsys):
    override = ["--set", "sweep.pinion_speed_rad_s=[50.0, 60.0]", "--set", "sweep.steps=40"]
    assert main(["run", str(scene), *override]) == 2
    assert "less than half of sweep.steps" in capsys.readouterr().err
    assert not commands.calls
    assert main(["map", str(scene), *override]) == 0
    assert main(["optimise", str(scene), *override]) == 0
    assert main(["run", str(scene), *override[:2]]) == 0


def test_optimise_needs_to_know_what_to_vary(scene, commands, capsys):
    text = scene.read_text()
    scene.write_text(text[: text.index("[optimise]")])
    assert main(["optimise", str(scene)]) == 2
    assert "Add a table [optimise]" in capsys.readouterr().err
    assert main(["run", str(scene)]) == 0


@pytest.fixture
def _no_cache_yet():
    """JAX as a user has it: it keeps no programs, and was not told not to."""
    names = ("jax_enable_compilation_cache", "jax_compilation_cache_dir")
    before = {name: getattr(jax.config, name) for name in names}
    for name, value in zip(names, (True, None), strict=True):
        jax.config.update(name, value)
    yield
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.mark.usefixtures("_no_cache_yet")
def test_a_cache_that_is_of_no_use_is_one_note(scene, commands, monkeypatch, capsys):
    Path("cache").write_text("")
    monkeypatch.setenv("JAXGEAR_CACHE", "cache")
    assert main(["run", str(scene)]) == 0
    errors = capsys.readouterr().err
    assert errors.count("jaxgear: warning: ") == 1
    assert "Compiled programs cannot be kept in cache/compiled" in errors
    assert len(commands.calls) == 1


def test_what_is_answered_at_once_imports_nothing_that_computes(scene):
    Path("broken.toml").write_text(scene.read_text().replace("teeth = 45", "tooth = 45"))
    code = """
import sys
from jaxgear._cli._main import main
lines = (["--help"], ["--version"], ["init", "power"], ["run", "broken.toml"], ["cache"])
lines += (["init", "--pair", "23", "64", "--module", "2"],)
codes = [main(line) for line in lines]
heavy = ("jax", "equinox", "diffrax", "scipy", "skfem", "meshio", "xarray", "pandas", "matplotlib")
print(codes, [name for name in heavy if name in sys.modules], file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1] == "[0, 0, 0, 2, 0, 0] []"


@pytest.mark.slow
def test_libraries_are_imported_no_sooner_than_they_are_used(tmp_path):
    """No numerics with all commands, nor finite elements with rigid bodies; no pyplot ever."""
    code = """
import pathlib, sys
import jaxgear._cli._commands
late = ("diffrax", "optax", "skfem", "meshio", "scipy.linalg", "scipy.optimize", "scipy.signal")
late += ("scipy.sparse", "scipy.spatial", "scipy.special", "scipy.stats")
print([name for name in late if name in sys.modules])
# Of studies of rigid bodies.
import jaxgear.study._run, jaxgear.study._relief_map, jaxgear.study._optimising
import jaxgear.study._modes, jaxgear.study._sweep
late = ("skfem", "fem_prep._assembly", "scipy.interpolate", "scipy.optimize", "scipy.spatial")
print([name for name in late if name in sys.modules])
# No matplotlib without pictures.
import jaxgear.study._fidelity._compare, jaxgear.study._condense, jaxgear.plot._atlas
import jaxgear.study._sensitivities, jaxgear.study._body_fields
from jaxgear._cli._folder import Folder
from jaxgear._cli._writing import save
save(None, {"a": [1.0]}, Folder(pathlib.Path(sys.argv[1]), pictures=False), "a")
print("matplotlib" in sys.modules)
import jaxgear.plot._cycle_pictures
print("matplotlib.pyplot" in sys.modules)
"""
    command = [sys.executable, "-c", code, tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == ["[]", "[]", "False", "False"], done.stderr


@pytest.mark.parametrize(
    "arguments",
    [[], ["fly"], ["run"], ["run", "a.toml", "--se", "x=1"], ["run", "a.toml", "b.toml"]],
)
def test_a_bad_command_line_is_exit_code_2(arguments, capsys):
    assert main(arguments) == 2
    assert "usage: jaxgear" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["--version"]])
def test_help_and_version_are_successes(arguments, capsys):
    assert main(arguments) == 0
    assert "jaxgear" in capsys.readouterr().out


def test_one_thread_is_asked_for_unless_the_user_did(monkeypatch, scene, commands):
    import threadpoolctl

    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    threads = []
    commands.COMMANDS["run"] = lambda *_: (
        threads.extend(pool["num_threads"] for pool in threadpoolctl.threadpool_info()) or {}
    )
    with threadpoolctl.threadpool_limits(2):
        assert main(["run", str(scene)]) == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"
    assert os.environ["OMP_NUM_THREADS"] == "1"
    assert set(threads) == {1}


def test_summary_is_indented_and_short(capsys):
    print_summary(_SUMMARY)
    assert capsys.readouterr().out.splitlines() == [
        "name      accessory",
        "versions",
        "  jax  1.2.3",
        "geometry",
        "  centre_distance_mm (a_w)  99.4503",
        "static",
        "  te_rms_um  2.36",
        "  speeds     [300 values]",
        "  bearings[0]  index 0",
    ]


@pytest.mark.parametrize("arguments", [["init", "accessory"], ["--help"]])
def test_a_reader_that_leaves_early_is_no_failure(tmp_path, arguments):
    environment = {**os.environ, "PYTHONPATH": str(Path(cli_package.__file__).parents[2])}
    # Without a buffer there would be nothing left for Python to flush at its exit.
    environment.pop("PYTHONUNBUFFERED", None)
    command = [sys.executable, "-m", "jaxgear", *arguments]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        errors = process.stderr.read()
    assert process.returncode == 0, errors
    assert b"Traceback" not in errors
    assert b"Exception ignored" not in errors
