import ast
import importlib
import importlib.util
import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import etendue

ROOT = Path(__file__).parent.parent.parent


def test_pictures_are_linear_float32_rows_first(scene: etendue.Scene) -> None:
    picture = scene.render(spp=4)
    assert (picture.shape, picture.dtype) == ((32, 48, 3), np.float32)
    assert picture.flags["C_CONTIGUOUS"]
    assert np.isfinite(picture).all()
    # The sky at the top is white, the ball in the middle red.
    assert picture[0].mean() == pytest.approx(1.0, abs=0.01)
    ball = picture[14:18, 22:26].mean(axis=(0, 1))
    assert ball[0] > 2 * ball[1] > 0


def test_threads_do_not_change_a_bit(scene: etendue.Scene) -> None:
    one = scene.render(spp=8, seed=3, threads=1)
    assert (scene.render(spp=8, seed=3, threads=2) == one).all()
    assert (scene.render(spp=8, seed=3) == one).all()
    assert (scene.render(spp=8, seed=4) != one).any()


def test_a_crop_is_a_part_of_the_picture(scene: etendue.Scene) -> None:
    whole = scene.render(spp=4)
    part = scene.render(spp=4, crop=(10, 5, 30, 25))
    assert part.shape == (20, 20, 3)
    assert (part == whole[5:25, 10:30]).all()


def test_one_edge_keeps_the_aspect(scene: etendue.Scene) -> None:
    assert scene.render(spp=1, width=24).shape == (16, 24, 3)


def test_aovs_come_by_name(scene: etendue.Scene) -> None:
    layers = scene.render(spp=4, aovs=["all"])
    shapes = {name: layer.shape[2] for name, layer in layers.items()}
    expected = {"rgb": 3, "alpha": 1, "albedo": 3, "normal": 3, "depth": 1, "position": 3, "uv": 2, "object": 1}
    assert shapes == expected | {"material": 1, "variance": 3, "samples": 1}
    assert all(layer.shape[:2] == (32, 48) and layer.dtype == np.float32 for layer in layers.values())
    assert (layers["rgb"] == scene.render(spp=4)).all()
    assert (layers["samples"] == 4).all()
    floor = layers["normal"][-1]
    assert floor == pytest.approx(np.broadcast_to([0, 1, 0], floor.shape), abs=1e-5)
    assert list(scene.render(spp=1, aovs=[])) == ["rgb", "alpha"]


def test_light_groups_add_up(scene: etendue.Scene) -> None:
    layers = scene.render(spp=4, aovs=[], light_groups=True)
    groups = [layer for name, layer in layers.items() if name.startswith("light.")]
    assert groups == [] or sum(groups) == pytest.approx(layers["rgb"], abs=1e-4)


def test_the_variance_is_of_the_right_size(scene: etendue.Scene) -> None:
    settings = {"spp": 16, "sampler": "independent"}
    pictures = np.stack([scene.render(seed=seed, **settings) for seed in range(24)])
    stated = np.mean([scene.render(seed=seed, aovs=["variance"], **settings)["variance"].mean() for seed in range(4)])
    assert stated == pytest.approx(pictures.var(axis=0, ddof=1).mean(), rel=0.25)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"spp": "many"}, "spp"),
        ({"spp": 0}, "at least one sample"),
        ({"integrator": "pth"}, "path"),
        ({"sampler": "dice"}, "sobol"),
        ({"filter": "none"}, "box"),
        ({"crop": (0, 0, 100, 100)}, "crop"),
        ({"crop": (0, 0, 1)}, "crop"),
        ({"width": 0}, "not possible"),
        ({"time": -1.0}, "time"),
        ({"threads": -1}, "threads"),
        ({"aovs": ["albdo"]}, "albedo"),
        ({"aovs": "albedo"}, "list"),
    ],
)
def test_settings_that_do_not_fit_are_refused(scene: etendue.Scene, settings: dict[str, object], message: str) -> None:
    with pytest.raises(etendue.SettingError, match=message):
        scene.render(**settings)


def test_unknown_keywords_are_refused(scene: etendue.Scene) -> None:
    with pytest.raises(TypeError, match="did you mean `spp`"):
        scene.render(sp=4)


def test_progress_is_told_in_the_calling_thread(scene: etendue.Scene) -> None:
    seen: list[etendue.Status] = []
    threads = set()

    def progress(status: etendue.Status) -> None:
        seen.append(status)
        threads.add(threading.get_ident())

    with_progress = scene.render(spp=64, progress=progress)
    assert (with_progress == scene.render(spp=64)).all()
    assert threads == {threading.get_ident()}
    fractions = [status.fraction for status in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert (seen[-1].spp_done, seen[-1].spp_target) == (64, 64)
    assert seen[-1].relative_error is not None
    assert 0 < seen[-1].relative_error < 1


def test_false_stops_and_keeps_what_is_done(scene: etendue.Scene) -> None:
    start = time.monotonic()
    layers = scene.render(spp=1_000_000, aovs=["samples"], progress=lambda status: status.spp_done < 2)
    assert time.monotonic() - start < 20
    assert 1 <= layers["samples"].min() < 1_000_000


def test_an_exception_of_the_callback_is_passed_on(scene: etendue.Scene) -> None:
    def fail(status: etendue.Status) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        scene.render(spp=1_000_000, progress=fail)


def test_time_and_noise_stop(scene: etendue.Scene) -> None:
    start = time.monotonic()
    assert scene.render(time=0.2, aovs=["samples"])["samples"].min() >= 1
    assert time.monotonic() - start < 10
    assert scene.render(noise=0.5, aovs=["samples"])["samples"].max() < 10_000


def test_other_threads_run_meanwhile(scene: etendue.Scene) -> None:
    counted = 0
    done = threading.Event()

    def count() -> None:
        nonlocal counted
        while not done.wait(0.001):
            counted += 1

    thread = threading.Thread(target=count)
    thread.start()
    scene.render(time=0.5, threads=1)
    before_end = counted
    done.set()
    thread.join()
    # With the lock held it would have counted a few times at most.
    assert before_end > 50


def test_ctrl_c_raises(scene: etendue.Scene) -> None:
    # Whoever starts the tests in the background may have Python ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    start = time.monotonic()
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            scene.render(spp=1_000_000, time=30)
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - start < 20


def test_scenes_render_in_several_threads_at_once(scene: etendue.Scene) -> None:
    pictures: list[np.ndarray] = []
    threads = [threading.Thread(target=lambda: pictures.append(scene.render(spp=4))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(pictures) == 4
    assert all((picture == pictures[0]).all() for picture in pictures)


def test_typed_keywords_are_those_of_the_renderer() -> None:
    spec = importlib.util.spec_from_file_location("generate_settings", ROOT / "scripts" / "generate_settings.py")
    assert spec is not None
    assert spec.loader is not None
    generator = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generator)
    assert generator.TARGET.read_text() == generator.text(), "run scripts/generate_settings.py"


def test_stubs_name_what_the_module_has() -> None:
    stubs = ast.parse((ROOT / "python" / "etendue" / "_etendue.pyi").read_text())
    named = {node.name for node in stubs.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    module = importlib.import_module("etendue._etendue")
    assert named == {name for name in dir(module) if not name.startswith("_")}
