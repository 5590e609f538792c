"""The explorer: its numbers are those of a run, and it answers who it should, and no other."""

import contextlib
import http.client
import http.server
import json
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.parse

import numpy as np
import pytest

from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear.explore import Explorer, _server
from jaxgear.explore._answers import PageAnswers
from jaxgear.scene._scene import example_scene, read_scene
from jaxgear.study import live_scene, statics

_PLAIN = {
    "mesh.stiffness": "constant",
    "mesh.stiffness_N_mm_um": 14.0,
    "mesh.slices": 3,
    "mesh.phases": 8,
}
_DEPTH, _TORQUE = "flank.wheel.tip_relief.depth_um", "pair.torque_pinion_Nm"
_MOVED = {_DEPTH: 12.0, "flank.pinion.crowning_um": 3.0, _TORQUE: 90.0}


@pytest.fixture(scope="module")
def scene():
    return example_scene("accessory").replace(_PLAIN)


@pytest.fixture(scope="module")
def live(scene):
    return live_scene(scene)


@pytest.fixture(scope="module")
def explorer(live, tmp_path_factory):
    made = Explorer(live, tmp_path_factory.mktemp("explored") / "mine.toml")
    thread = threading.Thread(target=made.serve)
    thread.start()
    yield made
    made.stop()
    thread.join(10.0)
    assert not thread.is_alive()


def _asked(explorer, method="POST", path="/start", body=b"{}", **headers):
    """Status and answer of one request; a header that is `None` is left out."""
    url = urllib.parse.urlsplit(explorer.address)
    token = urllib.parse.parse_qs(url.query)["token"][0]
    given = {"Host": url.netloc, "X-Token": token, "Content-Length": str(len(body))}
    given |= {name.replace("_", "-"): value for name, value in headers.items()}
    connection = http.client.HTTPConnection(url.hostname, url.port, timeout=60.0)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in given.items():
        for each in value if isinstance(value, list) else [value]:
            if each is not None:
                connection.putheader(name, each.replace("OWN", url.netloc))
    connection.endheaders(body)
    with contextlib.closing(connection), connection.getresponse() as reply:
        return reply.status, reply.read().decode()


def _found(explorer, question, **asked):
    status, text = _asked(explorer, path=f"/{question}", body=json.dumps(asked).encode())
    assert status == 200, text
    return json.loads(text)


def test_answers_are_sent_without_waiting(explorer, monkeypatch):
    """Else a body waits 40 ms until its head is received: that is TCP's delayed receipt."""
    seen, send = [], _server._Handler._send

    def watched(handler, *content):
        option = socket.IPPROTO_TCP, socket.TCP_NODELAY
        seen.append(handler.connection.getsockopt(*option))
        send(handler, *content)

    monkeypatch.setattr(_server._Handler, "_send", watched)
    assert _asked(explorer)[0] == 200
    assert len(seen) == 1
    assert seen[0] != 0


@pytest.mark.slow
def test_error_is_that_of_a_constant_stiffness(live):
    """One or two pairs in mesh, of which each gives by F / (c b): peak to peak is half of that."""
    found = live.cycle(live.values({})).numbers
    force = 80.0 / 30.587887812486937e-3
    assert found["te_peak_to_peak_um"] == pytest.approx(force / (2.0 * 14.0 * 9.5), rel=5e-3)
    doubled = live.cycle(live.values({_TORQUE: 160.0})).numbers
    assert doubled["te_rms_um"] == pytest.approx(2.0 * found["te_rms_um"], rel=1e-9)


@pytest.mark.slow
def test_numbers_are_those_of_a_run(live, scene):
    """At the scene's own values and at others, which are set by name."""
    for changes in ({}, _MOVED):
        found = live.cycle(live.values(changes))
        known = statics(scene.replace(changes))
        for name, value in found.numbers.items():
            assert value == pytest.approx(known.summary["static"][name], rel=1e-9), name
        error = known.dataset["transmission_error_um"].values
        np.testing.assert_allclose(found.te_um, error, rtol=1e-9)
        largest = known.summary["static"]["max_pressure_MPa"]
        assert np.max(found.pressure_MPa) == pytest.approx(largest, rel=1e-9)


@pytest.mark.slow
def test_slopes_agree_with_central_differences(live):
    at = live.values(_MOVED)
    slopes = live.slopes(at, "te_rms_um")
    for key, step in ((_DEPTH, 1e-3), (_TORQUE, 1e-2)):
        both = [
            live.cycle(live.values(_MOVED | {key: _MOVED[key] + way})).numbers["te_rms_um"]
            for way in (step, -step)
        ]
        assert slopes[key] == pytest.approx((both[0] - both[1]) / (2.0 * step), rel=1e-5)


_BUILT = {"wheel.profile_shift": 0.4, "pinion.shaft.bearings[0].radial_N_m": 9e8}


@pytest.mark.slow
def test_other_real_keys_move_as_in_a_run(live, scene):
    """The model is built anew for them; their slopes are forward, the others' in reverse."""
    wide = live
    for key in _BUILT:
        assert key in wide.others
        wide = wide.with_key(key)
    assert not set(_BUILT) & set(wide.others)
    assert wide.with_key(_DEPTH) is wide
    moved = _MOVED | _BUILT
    found = wide.cycle(wide.values(moved))
    known = statics(scene.replace(moved)).summary["static"]
    for name, value in found.numbers.items():
        assert value == pytest.approx(known[name], rel=1e-9), name
    te = lambda key, way: wide.cycle(wide.values(moved | {key: moved[key] * (1.0 + way)}))
    slopes = wide.slopes(wide.values(moved), "te_rms_um")
    for key in (_DEPTH, *_BUILT):
        both = [te(key, way).numbers["te_rms_um"] for way in (1e-4, -1e-4)]
        expected = (both[0] - both[1]) / (2e-4 * moved[key])
        assert slopes[key] == pytest.approx(expected, rel=1e-5), key


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("pinion.profil_shift", "no key of a scene"),
        ("pinion.teeth", "no real number that moves on its own"),
        ("mesh.contact", "no real number that moves on its own"),
        ("pinion.shaft.bearings[7].radial_N_m", "not in this scene"),
        ("flank.pinion.tip_relief", "no key of a scene"),
    ],
)
def test_keys_without_a_slider_say_why(explorer, key, words):
    status, text = _asked(explorer, path="/add", body=json.dumps({"key": key}).encode())
    assert status == 422
    assert words in json.loads(text)["error"]


def test_a_slider_more_is_written_too(live, tmp_path):
    ask = PageAnswers(live, tmp_path / "mine.toml").by_name
    found = ask["add"]({"key": "wheel.profile_shift"})
    assert found["knobs"][-1]["key"] == "wheel.profile_shift"
    assert "wheel.profile_shift" not in found["others"]
    written = ask["write"]({"values": {"wheel.profile_shift": 0.45}})
    assert read_scene(written["file"]).value("wheel.profile_shift") == 0.45


@pytest.mark.slow
def test_curve_passes_through_the_cycle(live):
    """Where both depths are the same, the curve has the RMS of the cycle itself."""
    curve = live.relief_curve(live.values({}))
    depth = float(curve["depth_um"][6])
    both = {_DEPTH: depth, _DEPTH.replace("wheel", "pinion"): depth}
    rms = live.cycle(live.values(both)).numbers["te_rms_um"]
    assert curve["te_rms_um"][6] == pytest.approx(rms, rel=1e-9)


def test_values_have_bounds(live):
    with pytest.raises(InputError, match=r"must be between 0 and 40, got 50"):
        live.values({_DEPTH: 50.0})
    with pytest.raises(InputError, match="not among the keys"):
        live.values({"pair.module_mm": 2.0})
    with pytest.raises(InputError, match="no response te"):
        live.slopes(live.values({}), "te")


@pytest.mark.slow
def test_page_asks_and_is_answered(explorer, live):
    status, page = _asked(explorer, "GET", urllib.parse.urlsplit(explorer.address).path, b"")
    assert status == 403
    address = urllib.parse.urlsplit(explorer.address)
    status, page = _asked(explorer, "GET", f"/?{address.query}", b"")
    assert status == 200
    assert "/* script */" not in page
    assert len(_found(explorer, "start")["knobs"]) == len(live.knobs)
    found = _found(explorer, "cycle", values=_MOVED)
    known = live.cycle(live.values(_MOVED))
    assert found["numbers"] == known.numbers
    assert _found(explorer, "slopes", values=_MOVED, response="te_rms_um")[_DEPTH] != 0.0
    assert len(_found(explorer, "curve")["te_rms_um"]) == len(_found(explorer, "curve")["depth_um"])


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        ({"X_Token": None}, 403),
        ({"X_Token": "guess"}, 403),
        ({"Host": "example.org"}, 403),
        ({"Host": None}, 403),
        ({"Host": ["OWN", "example.org"]}, 403),
        ({"path": "/../../etc/passwd"}, 404),
        ({"path": "/by_name"}, 404),
        ({"Content_Length": "99999999"}, 413),
        ({"Content_Length": "-1"}, 413),
        ({"Content_Length": "many"}, 413),
        ({"body": b"[1]"}, 422),
        ({"body": b"{"}, 422),
        ({"body": b"\xff\xfe"}, 422),
        ({"body": b"[" * 60_000}, 422),
        ({"path": "/cycle", "body": b'{"values": {"a": ' + b"9" * 400 + b"}}"}, 422),
        ({"path": "/cycle", "body": b'{"values": {"a": ' + b"9" * 5000 + b"}}"}, 422),
        ({"path": "/cycle", "body": b'{"values": 3}'}, 422),
        ({"path": "/cycle", "body": b'{"values": {"pair.module_mm": 1}}'}, 422),
        ({"path": "/cycle", "body": b'{"values": {"pair.torque_pinion_Nm": NaN}}'}, 422),
        ({"path": "/cycle", "body": b'{"values": {"pair.torque_pinion_Nm": true}}'}, 422),
        ({"path": "/slopes", "body": b"{}"}, 422),
        ({"path": "/sweep", "body": b"{}"}, 422),
        ({"method": "PUT"}, 501),
    ],
)
def test_what_is_not_for_it_is_refused(explorer, asked, status):
    """Foreign pages, wrong paths, bodies that are none: each with its reason; it goes on."""
    found, text = _asked(explorer, **asked)
    assert found == status
    assert status == 501 or json.loads(text)["error"]
    assert _found(explorer, "start")["name"] == "accessory"


def test_a_question_that_does_not_come_whole_is_given_up(explorer, monkeypatch):
    monkeypatch.setattr("jaxgear.explore._server._Handler.timeout", 0.2)
    status, text = _asked(explorer, Content_Length="500")
    assert (status, json.loads(text)) == (408, {"error": "The question has not come whole."})


@pytest.mark.slow
def test_interruption_ends_the_command_while_it_computes(tmp_path, monkeypatch):
    """At once, without a word of what is torn down."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", "accessory", "--set", "mesh.slices=3"]) == 0
    command = [sys.executable, "-u", "-m", "jaxgear", "explore", "accessory.toml"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stdout is not None
        address = urllib.parse.urlsplit(running.stdout.readline().decode().strip())
        connection = http.client.HTTPConnection(address.netloc, timeout=60.0)
        token = urllib.parse.parse_qs(address.query)["token"][0]
        connection.request("POST", "/curve", b"{}", {"X-Token": token})
        time.sleep(1.0)
        running.send_signal(signal.SIGINT)
        try:
            _, told = running.communicate(timeout=30.0)
        finally:
            running.kill()
        connection.close()
    assert (running.returncode, told) == (0, b"")


def test_scene_is_written_with_what_was_moved(explorer):
    found = _found(explorer, "write", values=_MOVED)
    written = read_scene(found["file"])
    assert found["changed"] == 3
    assert [written.value(key) for key in _MOVED] == list(_MOVED.values())


def test_address_is_told_and_a_bad_port_refused(tmp_path, monkeypatch, capsys):
    """The command itself, up to where it would wait for a browser."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", "accessory", "--set", "mesh.slices=3"]) == 0

    def interrupt(self, poll_interval):
        raise KeyboardInterrupt

    monkeypatch.setattr(http.server.ThreadingHTTPServer, "serve_forever", interrupt)
    assert main(["explore", "accessory.toml"]) == 0
    assert "http://127.0.0.1:" in capsys.readouterr().out
    assert main(["explore", "accessory.toml", "--key", "pinion.teeth"]) == 2
    assert "pinion.teeth is no real number" in capsys.readouterr().err
    assert main(["explore", "accessory.toml", "--key", "wheel.bore_mm", "--port", "99999"]) == 2
    assert "Name another" in capsys.readouterr().err
