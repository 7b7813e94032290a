"""Attacks on packages, and what a scene may do on a worker."""

import contextlib
import io
import os
import stat
import struct
import zipfile
from pathlib import Path

import pytest
from sqlalchemy import select

from etendue.farm import collect, packages
from etendue.farm.accounts import Actor
from etendue.farm.config import Limits
from etendue.farm.errors import FarmError, ForbiddenError, InvalidError, NotFoundError, PackageError, QuotaError, TooLargeError
from etendue.farm.models import Event
from etendue.farm.service import Farm
from etendue.farm.states import Role

from .conftest import BALLS, SPIN, Runner, packed


def zipped(*entries: tuple[str | zipfile.ZipInfo, str | bytes]) -> io.BytesIO:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries:
            archive.writestr(name, content)
    data.seek(0)
    return data


def refused(farm: Farm, actor: Actor, data: io.BytesIO, name: str = "scene.zip") -> str:
    """Return the sentence of a refusal, which is in the log as well."""
    with pytest.raises((PackageError, TooLargeError)) as caught:
        farm.upload(actor, data, name)
    with farm.database.read() as session:
        last = session.scalars(select(Event).order_by(Event.id.desc()).limit(1)).one()
    assert last.kind == "package-refused"
    assert actor.name in last.message
    assert farm.store.names("packages") == []
    return str(caught.value)


@pytest.mark.parametrize(
    "name",
    [
        "../evil.xml",
        "a/../../evil.xml",
        "/etc/evil.xml",
        "C:/evil.xml",
        "..\\evil.xml",
        "a//b.xml",
        "./a.xml",
        "a/\u202ecod.xml",
        "con/scene.xml",
        "nul.xml",
        "scene.xml.",
        "a" * 300 + ".xml",
        "x/" * 70 + "a.xml",
    ],
)
def test_paths_that_lead_out_are_refused(farm: Farm, actor: Actor, name: str) -> None:
    assert "package has a file" in refused(farm, actor, zipped(("scene.xml", BALLS), (name, "x")))


def test_links_devices_and_doubles_are_refused(farm: Farm, actor: Actor) -> None:
    for kind in (stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR):
        entry = zipfile.ZipInfo("maps")
        entry.external_attr = (kind | 0o777) << 16
        assert "link or device" in refused(farm, actor, zipped(("scene.xml", BALLS), (entry, "/etc/passwd")))
    assert "two files of one name" in refused(farm, actor, zipped(("scene.xml", BALLS), ("SCENE.xml", BALLS)))
    with pytest.warns(UserWarning, match="Duplicate"):
        doubled = zipped(("scene.xml", BALLS), ("scene.xml", BALLS))
    assert "two files of one name" in refused(farm, actor, doubled)
    # A file where another one needs a folder.
    assert "two files of one name" in refused(farm, actor, zipped(("scene.xml", BALLS), ("a", "x"), ("a/b", "x")))


def test_bombs_and_lies_about_sizes_are_refused(farm: Farm, actor: Actor) -> None:
    bomb = zipped(("scene.xml", BALLS), ("zeros.bin", bytes(100 << 20)))
    assert len(bomb.getvalue()) < 1 << 20
    assert "zip bombs" in refused(farm, actor, bomb)
    honest = zipped(("scene.xml", BALLS), ("zeros.bin", bytes(1 << 20))).getvalue()
    # The directory says 10 bytes; the data expand to a million.
    lie = honest.replace(struct.pack("<I", 1 << 20), struct.pack("<I", 10))
    assert refused(farm, actor, io.BytesIO(lie))
    farm.config.limits.package_files = 5
    many = zipped(("scene.xml", BALLS), *((f"{i}.txt", "") for i in range(10)))
    assert "at most 5" in refused(farm, actor, many)


def test_oversize_uploads_are_refused_while_they_come(farm: Farm, actor: Actor) -> None:
    farm.config.limits.upload_bytes = 1000

    class Endless(io.RawIOBase):
        given = 0

        def read(self, size: int = -1) -> bytes:
            self.given += size
            return bytes(size)

    endless = Endless()
    with pytest.raises(TooLargeError):
        farm.upload(actor, endless, "a.zip")  # type: ignore[arg-type]
    assert endless.given < 10_000


def test_damaged_and_encrypted_zips_are_refused(farm: Farm, actor: Actor) -> None:
    good = zipped(("scene.xml", BALLS)).getvalue()
    for cut in (10, len(good) // 2, len(good) - 5):
        assert refused(farm, actor, io.BytesIO(good[:cut]))
    for place in range(0, len(good), 7):
        broken = bytearray(good)
        broken[place] ^= 0xFF
        # Whatever is broken, it is refused with a sentence or harmless.
        with contextlib.suppress(FarmError):
            farm.upload(actor, io.BytesIO(bytes(broken)), "scene.zip")
    encrypted = bytearray(good)
    encrypted[6] |= 1
    encrypted[good.rindex(b"PK\x01\x02") + 8] |= 1
    with pytest.raises(PackageError, match="encrypted"):
        farm.upload(actor, io.BytesIO(bytes(encrypted)), "scene.zip")


def test_what_is_no_scene_is_refused(farm: Farm, actor: Actor) -> None:
    assert "no scene file" in refused(farm, actor, zipped(("notes.txt", "hello")))
    assert "several scene files" in refused(farm, actor, zipped(("a.xml", BALLS), ("b.xml", BALLS)))
    assert "zip files or single scenes" in refused(farm, actor, io.BytesIO(b"#!/bin/sh"), "run.sh")
    message = refused(farm, actor, zipped(("scene.xml", BALLS.replace("sphere", "spere"))))
    assert "scene.xml:4" in message
    assert "/tmp" not in message


def test_the_same_content_is_kept_once_and_only_its_owner_may_use_it(farm: Farm, actor: Actor) -> None:
    farm.accounts.create(actor, "ann")
    ann = farm.accounts.by_token(farm.accounts.create_token(actor, "t", user="ann"))
    farm.accounts.create(actor, "bob")
    bob = farm.accounts.by_token(farm.accounts.create_token(actor, "t", user="bob"))
    assert ann is not None
    assert bob is not None
    first = farm.upload(ann, packed(scene_xml=BALLS, maps__a_txt="x"), "a.zip")
    # Another name for the package and another order of files: the same content.
    again = farm.upload(ann, zipped(("maps/a.txt", "x"), ("scene.xml", BALLS)), "b.zip")
    assert again.id == first.id
    assert len(farm.store.names("packages")) == 1
    with pytest.raises(NotFoundError):
        farm.jobs.submit(bob, {"package": first.id})
    with pytest.raises(NotFoundError):
        farm.package(bob, first.id)
    job = farm.jobs.submit(ann, {"package": first.id})
    for steal in (farm.jobs.get, farm.jobs.cancel, farm.jobs.delete, farm.pictures.outputs):
        with pytest.raises(NotFoundError):
            steal(bob, job.id)
    assert farm.jobs.find(bob).total == 0
    shared = farm.jobs.submit(ann, {"package": first.id, "shared": True})
    assert farm.jobs.get(bob, shared.id).actions == []
    with pytest.raises(ForbiddenError):
        farm.jobs.cancel(bob, shared.id)
    farm.upload(bob, packed(scene_xml=BALLS, maps__a_txt="x"), "c.zip")
    assert farm.jobs.submit(bob, {"package": first.id}).owner == "bob"


def test_quotas_hold(farm: Farm, actor: Actor) -> None:
    farm.accounts.create(actor, "ann", max_jobs=1, max_bytes=len(BALLS) + 10)
    ann = farm.accounts.by_token(farm.accounts.create_token(actor, "t", user="ann"))
    assert ann is not None
    package = farm.upload(ann, packed(scene_xml=BALLS), "a.zip")
    with pytest.raises(QuotaError, match="bytes"):
        farm.upload(ann, packed(scene_xml=BALLS + "<!-- more -->"), "b.zip")
    farm.jobs.submit(ann, {"package": package.id})
    with pytest.raises(QuotaError, match="1 jobs"):
        farm.jobs.submit(ann, {"package": package.id})
    viewer = farm.accounts.update(actor, "ann", role=Role.VIEWER)
    assert viewer.role == "viewer"
    with pytest.raises(ForbiddenError):
        farm.upload(farm.accounts.by_token(farm.accounts.create_token(actor, "t", user="ann")) or ann, packed(scene_xml=BALLS), "a.zip")


def test_a_scene_reads_and_writes_nothing_outside_of_its_package(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path) -> None:
    secret = tmp_path / "secret.inc"
    secret.write_text("#declare Stolen = 1;")
    writes = tmp_path / "written.txt"
    attack = SPIN + f'#fopen F "{writes}" write\n#write (F, "gotcha")\n#fclose F\n#fopen G "../../escape.txt" write\n#fclose G\n'
    with contextlib.suppress(PackageError):
        package = farm.upload(actor, packed(spin_pov=attack), "a.zip")
        job = runner.finish(farm.jobs.submit(actor, {"package": package.id, "settings": {"width": 16, "height": 12}}))
        assert job.state in ("done", "failed")
    assert not writes.exists()
    assert not list(tmp_path.rglob("escape.txt"))
    for name in (str(secret), "../secret.inc", "../../../../../../../../etc/passwd"):
        with pytest.raises(PackageError):
            farm.upload(actor, packed(spin_pov=f'#include "{name}"\n' + SPIN), "a.zip")
    texture = BALLS.replace("</scene>", '<shape type="ply"><string name="filename" value="/etc/passwd"/></shape></scene>')
    with pytest.raises(PackageError, match="outside"):
        farm.upload(actor, packed(scene_xml=texture), "a.zip")


def test_reading_a_scene_without_end_is_cut_off(farm: Farm, actor: Actor) -> None:
    farm.config.limits.check_secs = 5.0
    endless = "#declare N = 0; #while (1) #declare N = N + 1; #end\n" + SPIN
    with pytest.raises(PackageError):
        farm.upload(actor, packed(spin_pov=endless), "a.zip")


def test_a_package_is_unpacked_once_on_a_machine_and_checked(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "scene.xml").write_text(BALLS)
    found = packages.manifest(folder, ["scene.xml"], Limits())
    packed_file = tmp_path / "scene.zip"
    packages.write_zip(folder, found.files, packed_file)
    fetched: list[Path] = []

    def fetch(path: Path) -> None:
        fetched.append(path)
        path.write_bytes(packed_file.read_bytes())

    for _ in range(3):
        kept = packages.cached_package(found.id, fetch, tmp_path / "cache", Limits())
        assert (kept / "scene.xml").read_text() == BALLS
    assert len(fetched) == 1
    with pytest.raises(PackageError, match="another content"):
        packages.cached_package("0" * 64, fetch, tmp_path / "cache", Limits())
    # The same files give the same bytes, whenever they were written.
    os.utime(folder / "scene.xml", (1, 1))
    packages.write_zip(folder, found.files, tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == packed_file.read_bytes()


def test_the_files_of_a_scene_are_those_that_it_names(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "scene.pov").write_text('#include "colors/wood.inc"\nplane { y, 0 }')
    (tmp_path / "colors").mkdir()
    (tmp_path / "colors" / "wood.inc").write_text('pigment { image_map { png "Wood Grain.PNG" } }')
    (tmp_path / "maps" / "wood grain.png").write_bytes(b"1")
    (tmp_path / "maps" / "frame1.png").write_bytes(b"1")
    (tmp_path / "result.png").write_bytes(b"1")
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "wood.inc").write_bytes(b"1")
    _, files = collect.scene_files(tmp_path / "scene.pov", [])
    assert files == ["colors/wood.inc", "maps/wood grain.png", "scene.pov"]
    _, files = collect.scene_files(tmp_path / "scene.pov", [], ["maps/*.png"])
    assert "maps/frame1.png" in files
    _, files = collect.scene_files(tmp_path / "scene.pov", [], everything=True)
    assert "result.png" in files
    assert not any(".git" in name for name in files)
    with pytest.raises(InvalidError, match="no file"):
        collect.scene_files(tmp_path / "scene.pov", [], ["*.exr"])
