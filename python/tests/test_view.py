"""Scenes seen from elsewhere, pictures on their way, and the viewer's server."""

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import etendue

from .conftest import XML

POV = """#version 3.7; global_settings { assumed_gamma 1 }
camera { location <0, 1, -4> look_at <0, 0.5, 0> right x*4/3 }
light_source { <3, 5, -4> rgb 1 }
sphere { <0, 0.5, 0>, 0.5 pigment { rgb <0.8, 0.2, 0.1> } }
plane { y, 0 pigment { rgb 0.7 } }
"""


@pytest.fixture(params=["xml", "pov"])
def any_scene(request: pytest.FixtureRequest, tmp_path: Path) -> etendue.Scene:
    path = tmp_path / f"scene.{request.param}"
    path.write_text(XML if request.param == "xml" else POV)
    return etendue.load(path)


SIZE = {"width": 48, "height": 32}


def test_the_own_view_is_the_same_picture(any_scene: etendue.Scene) -> None:
    view = any_scene.view()
    assert view.zoom == 1.0
    seen = any_scene.with_view(view.world_from_camera)
    assert (seen.view().world_from_camera == view.world_from_camera).all()
    plain = any_scene.render(spp=2, **SIZE)
    assert np.abs(seen.render(spp=2, **SIZE) - plain).max() < 1e-5
    # What the first rendering has compiled is as good the second time, whatever was looked at in between.
    assert (any_scene.render(spp=2, **SIZE) == plain).all()


def test_a_moved_camera_sees_what_is_there(any_scene: etendue.Scene) -> None:
    matrix = any_scene.view().world_from_camera
    right, back = matrix[:3, 0], matrix[:3, 2]
    at_middle = any_scene.render(spp=1, aovs=["position", "depth"], **SIZE)
    nearer = matrix.copy()
    nearer[:3, 3] -= back
    closer = any_scene.with_view(nearer).render(spp=1, aovs=["depth"], **SIZE)
    # The ball is in the middle: one step ahead, one unit less.
    assert closer["depth"][16, 24, 0] == pytest.approx(at_middle["depth"][16, 24, 0] - 1, abs=0.02)
    aside = matrix.copy()
    aside[:3, 3] += 0.3 * right
    seen = any_scene.with_view(aside).render(spp=1, aovs=["object"], **SIZE)["object"][:, :, 0]
    before = any_scene.render(spp=1, aovs=["object"], **SIZE)["object"][:, :, 0]
    ball = before[16, 24]
    # Stepping to the right moves the ball to the left.
    assert np.argwhere(seen == ball)[:, 1].mean() < np.argwhere(before == ball)[:, 1].mean() - 2


def test_zoom_enlarges(any_scene: etendue.Scene) -> None:
    view = any_scene.view()
    one = any_scene.render(spp=1, aovs=["object"], **SIZE)["object"][:, :, 0]
    two = any_scene.with_view(view.world_from_camera, 2.0).render(spp=1, aovs=["object"], **SIZE)["object"][:, :, 0]
    ball = one[16, 24]
    assert (two == ball).sum() > 3 * (one == ball).sum()


@pytest.mark.parametrize("matrix", [np.zeros((4, 4)), np.full((4, 4), np.nan), np.eye(3), np.diag([1, 1, 1e-300, 1.0])])
def test_absurd_cameras_are_refused(scene: etendue.Scene, matrix: np.ndarray) -> None:
    with pytest.raises(etendue.SettingError):
        scene.with_view(matrix)
    with pytest.raises(etendue.SettingError):
        scene.with_view(np.eye(4), zoom=-1.0)
    with pytest.raises(etendue.SceneError, match="no camera"):
        scene.view("nowhere")


def test_previews_sharpen_and_end_as_the_picture(scene: etendue.Scene) -> None:
    seen: list[tuple[dict[str, np.ndarray], int]] = []
    final = scene.render(spp=3000, aovs=["samples"], preview=lambda layers, status: seen.append((layers, status.spp_done)))
    assert seen
    counts = [spp for _, spp in seen]
    assert counts == sorted(counts)
    for layers, spp in seen:
        assert layers["rgb"].shape == (32, 48, 3)
        assert (layers["samples"] == spp).all()
    errors = [np.abs(layers["rgb"] - final["rgb"]).mean() for layers, _ in seen]
    assert errors[-1] < errors[0] or len(errors) == 1

    def fail(layers: object, status: object) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        scene.render(spp=1_000_000, preview=fail)


# ------------------------------------------------------------------------------------------------------------- the server

pytest.importorskip("fastapi", reason="the viewer's packages are not installed")

from starlette.testclient import TestClient  # noqa: E402
from starlette.websockets import WebSocketDisconnect  # noqa: E402

from etendue.console.live import Live, Look  # noqa: E402
from etendue.console.viewer import Viewers, create_app  # noqa: E402
from etendue.console.wire import decode_layer, encode_layer  # noqa: E402

HOST = "127.0.0.1:8700"


def test_layers_go_there_and_back() -> None:
    layer = np.array([[[0.0, 1.5, -2.25], [1e9, np.inf, np.nan]]], dtype=np.float32)
    header, back = decode_layer(encode_layer("rgb", layer, {"spp": 4}))
    assert header == {"spp": 4, "layer": "rgb", "width": 2, "height": 1, "channels": 3, "dtype": "f2"}
    assert back[0, 0].tolist() == [0.0, 1.5, -2.25]
    assert back[0, 1, 0] == 65504.0
    assert np.isinf(back[0, 1, 1])
    assert np.isnan(back[0, 1, 2])
    depth = np.array([[[123456.78], [3.0]]], dtype=np.float32)
    assert (decode_layer(encode_layer("depth", depth, {}))[1] == depth).all()
    with pytest.raises(ValueError, match="header"):
        decode_layer(b"12")


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[tuple[TestClient, Live, Path]]:
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    viewers = Viewers()
    live = Live(lambda: etendue.load(path), Look(settings={"spp": 64}), viewers.tell)
    app = create_app(live, viewers, "secret", frozenset({HOST}), "scene <b>.xml")
    with TestClient(app, base_url=f"http://{HOST}", follow_redirects=False) as client:
        yield client, live, path


def enter(client: TestClient) -> None:
    response = client.get("/", params={"token": "secret"})
    assert (response.status_code, response.headers["location"]) == (303, "/")


def test_only_the_key_opens_the_page(viewer: tuple[TestClient, Live, Path]) -> None:
    client, _, _ = viewer
    assert client.get("/").status_code == 403
    assert client.get("/", params={"token": "Secret"}).status_code == 403
    assert client.get("/save/a.png").status_code == 403
    # Another site whose name leads to this address (DNS rebinding).
    assert client.get("/", params={"token": "secret"}, headers={"host": "evil.example"}).status_code == 403
    enter(client)
    page = client.get("/")
    assert page.status_code == 200
    assert "script-src 'self'" in page.headers["content-security-policy"]
    assert client.get("/static/js/viewer.js").status_code == 200
    assert client.get("/static/../viewer.py").status_code == 404
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/live", headers={"origin": "http://evil.example"}):
        pass
    client.cookies.clear()
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/live", headers={"origin": f"http://{HOST}"}):
        pass


def test_a_page_gets_pictures_and_moves_the_camera(viewer: tuple[TestClient, Live, Path]) -> None:
    client, live, path = viewer
    enter(client)
    with client.websocket_connect(f"ws://{HOST}/live", headers={"origin": f"http://{HOST}"}) as socket:
        texts: list[dict[str, object]] = []

        def picture(fits: object = lambda header: True) -> tuple[dict[str, object], np.ndarray]:
            end = time.monotonic() + 20
            while time.monotonic() < end:
                message = socket.receive()
                if message.get("text"):
                    texts.append(json.loads(message["text"]))
                    continue
                header, layer = decode_layer(message["bytes"])
                socket.send_json({"type": "ready"})
                if fits(header):  # type: ignore[operator]
                    return header, layer
            raise AssertionError("no such picture came")

        first, _ = picture()
        about = texts[0]
        assert about["type"] == "scene"
        assert about["title"] == "scene <b>.xml"
        assert "path" in about["integrators"]  # type: ignore[operator]
        assert first["pivot"] is not None
        done, layer = picture(lambda h: h["done"])
        assert (done["spp"], done["width"], done["height"]) == (64, 48, 32)
        expected = etendue.load(path).render(spp=64)
        assert layer == pytest.approx(expected, rel=1e-3, abs=1e-4)

        matrix = np.array(about["matrix"]).reshape(4, 4)
        matrix[:3, 3] += matrix[:3, 0]
        socket.send_json({"type": "camera", "matrix": matrix.ravel().tolist(), "zoom": 1.5})
        moved, layer = picture(lambda h: h["done"] and h["generation"] > done["generation"])
        assert layer == pytest.approx(etendue.load(path).with_view(matrix, 1.5).render(spp=64), rel=1e-3, abs=1e-4)

        socket.send_json({"type": "layer", "layer": "normal"})
        _, layer = picture(lambda h: h["layer"] == "normal")
        assert np.linalg.norm(layer[-1], axis=1) == pytest.approx(1, abs=0.01)
        socket.send_json({"type": "settings", "settings": {"integrator": "normals", "spp": 2}})
        assert picture(lambda h: h["done"] and h["generation"] > moved["generation"])[0]["spp"] == 2

        texts.clear()
        for order in [{"type": "camera", "matrix": [0] * 16}, {"type": "settings", "settings": {"width": 10**9}}, {"type": "dance"}, [], 3]:
            socket.send_json(order)
        while len([t for t in texts if t["type"] == "refused"]) < 5:
            message = socket.receive()
            if message.get("text"):
                texts.append(json.loads(message["text"]))
    assert client.get("/save/a b.png", params={"exposure": 1}).headers["content-disposition"].endswith("a%20b.png")
    saved = client.get("/save/a.exr")
    (path.parent / "saved.exr").write_bytes(saved.content)
    layers = etendue.read_layers(path.parent / "saved.exr")
    assert live.frame is not None
    assert (layers["rgb"] == live.frame.layers["rgb"]).all()
    assert "normal" in layers
    assert client.get("/save/a.exe").status_code == 422
    assert client.get("/save/a.png", params={"tonemap": "none"}).status_code == 422


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    changed = threading.Event()
    live = Live(lambda: etendue.load(path), Look(settings={"spp": 1}), changed.set)
    live.start()

    def wait(fits: object) -> None:
        end = time.monotonic() + 20
        while not fits():  # type: ignore[operator]
            assert time.monotonic() < end
            changed.wait(0.1)
            changed.clear()

    try:
        wait(lambda: live.frame is not None and live.frame.is_done)
        path.write_text(XML.replace("<scene", "<scne"))
        wait(lambda: live.error is not None)
        assert live.frame is not None  # the last good picture stays
        path.write_text(XML.replace('value="48"', 'value="50"'))
        wait(lambda: live.frame is not None and live.frame.layers["rgb"].shape[1] == 50 and live.error is None)
        live.show(Look(settings={"spp": 1, "integrator": "none"}))
        wait(lambda: live.error is not None and "none" in live.error)
    finally:
        live.close()


def test_methods_are_those_of_the_program(tmp_path: Path) -> None:
    (tmp_path / "a.pov").write_text(POV)
    # What the page selects for a scene without a choice is the file's, else the first of the list.
    assert etendue.load(tmp_path / "a.pov").info()["integrator"] == "whitted"
    assert etendue.integrators()[0] == "auto"
    listed = next(p.doc for p in etendue.parameters() if p.name == "integrator")
    assert set(etendue.integrators()) - {"illuminance"} == set(listed.removeprefix("Method: ").rstrip(".").split(", "))
