from pathlib import Path

import numpy as np
import pytest

import etendue


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(1).random((20, 30, 3), dtype=np.float32)


def test_all_layers_go_through_exr(tmp_path: Path, scene: etendue.Scene) -> None:
    path = tmp_path / "layers.exr"
    layers = scene.render(spp=2, aovs=["all"])
    etendue.write_image(path, layers)
    read = etendue.read_layers(path)
    assert read.keys() == layers.keys()
    for name, layer in layers.items():
        assert (read[name] == layer).all(), name
    assert (etendue.read_image(path) == layers["rgb"]).all()


@pytest.mark.parametrize(("extension", "tolerance"), [("png", 0.01), ("exr", 0), ("pfm", 0), ("hdr", 0.01), ("jpg", 0.5)])
def test_pictures_go_through_files(tmp_path: Path, picture: np.ndarray, extension: str, tolerance: float) -> None:
    path = tmp_path / f"picture.{extension}"
    etendue.write_image(path, picture)
    if extension != "pfm":
        assert etendue.read_image(path) == pytest.approx(picture, abs=tolerance)
    assert path.stat().st_size > 100


def test_gray_pictures_and_other_types(tmp_path: Path) -> None:
    path = tmp_path / "gray.exr"
    gray = np.linspace(0, 1, 12).reshape(3, 4)
    etendue.write_image(path, gray)
    assert etendue.read_image(path) == pytest.approx(np.repeat(gray[:, :, None], 3, axis=2), abs=1e-7)


def test_pictures_that_do_not_fit_are_refused(tmp_path: Path, picture: np.ndarray) -> None:
    with pytest.raises(etendue.ImageError, match="shape"):
        etendue.write_image(tmp_path / "a.png", np.zeros((2, 2, 7)))
    with pytest.raises(etendue.ImageError, match="same height"):
        etendue.write_image(tmp_path / "a.exr", {"rgb": picture, "depth": picture[1:, :, :1]})
    with pytest.raises(etendue.UnsupportedError, match="xyz"):
        etendue.write_image(tmp_path / "a.xyz", picture)
    with pytest.raises(etendue.SettingError, match="agx"):
        etendue.write_image(tmp_path / "a.png", picture, tonemap="nice")
    with pytest.raises(FileNotFoundError):
        etendue.read_image(tmp_path / "none.png")
    damaged = tmp_path / "damaged.exr"
    etendue.write_image(damaged, picture)
    damaged.write_bytes(damaged.read_bytes()[:-100])
    with pytest.raises(etendue.ImageError, match="damaged"):
        etendue.read_image(damaged)
    assert sorted(tmp_path.iterdir()) == [damaged]


def test_tone_mapping(picture: np.ndarray) -> None:
    shown = etendue.tonemap(picture)
    srgb = np.where(picture <= 0.0031308, 12.92 * picture, 1.055 * picture ** (1 / 2.4) - 0.055)
    assert shown == pytest.approx(srgb, abs=1e-4)
    assert etendue.tonemap(picture, exposure=1) == pytest.approx(etendue.tonemap(2 * picture), abs=1e-5)
    for operator in ("filmic", "aces", "agx"):
        mapped = etendue.tonemap(100 * picture, operator)
        assert 0 <= mapped.min() <= mapped.max() <= 1


def test_comparison(picture: np.ndarray) -> None:
    same = etendue.compare(picture, picture)
    assert (same["mse"], same["flip"], same["ssim"]) == (0, 0, 1)
    other = picture + np.float32(0.1)
    figures = etendue.compare(other, picture)
    assert figures["mse"] == pytest.approx(0.01, rel=1e-4)
    assert figures["relmse"] == pytest.approx(np.mean(0.01 / (picture**2 + 0.01)), rel=1e-3)
    assert figures["max"] == pytest.approx(0.1, rel=1e-4)
    heat = etendue.flip_map(other, picture, hdr=False)
    assert heat.shape == (20, 30, 1)
    assert heat.mean() == pytest.approx(etendue.compare(other, picture, hdr=False)["flip"], rel=1e-4)
    with pytest.raises(etendue.ImageError, match="sizes"):
        etendue.compare(picture, picture[1:])
