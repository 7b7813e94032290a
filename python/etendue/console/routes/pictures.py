"""Pictures of frames: previews, layers for the picture viewer, finished files, films."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import IO, TYPE_CHECKING, Annotated, Literal
from urllib.parse import quote

from fastapi import APIRouter, Header, Path, Query, Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel
from starlette.background import BackgroundTask

from etendue.console import movie
from etendue.console.auth import TheFarm, Who
from etendue.console.routes.parameters import PLAIN, FrameNumber, JobId, refusals
from etendue.console.wire import MEDIA_TYPE, encode_layer
from etendue.farm.errors import NotFoundError
from etendue.farm.views import Output, Picture

if TYPE_CHECKING:
    from typing_extensions import Buffer

router = APIRouter(tags=["pictures"])

Tonemap = Literal["standard", "filmic", "aces", "agx"]
Layer = Annotated[str, Path(min_length=1, max_length=100, pattern=PLAIN, description="Name of a layer.")]
Exposure = Annotated[float, Query(ge=-64, le=64, description="In stops.")]
Size = Annotated[int | None, Query(ge=1, le=4096, description="Longest edge in pixels.")]
IfNoneMatch = Annotated[str | None, Header(description="ETag of the picture that the client has.")]
PNG: dict[int | str, dict[str, object]] = {200: {"content": {"image/png": {}}}, 304: {"description": "The client has the newest."}}
TYPES = {"exr": "image/x-exr", "png": "image/png", "jpg": "image/jpeg", "hdr": "image/vnd.radiance", "pfm": "image/x-portable-floatmap"}
CHUNK = 1 << 18


class Layers(BaseModel):
    """The layers of a frame."""

    layers: list[str]


def attachment(name: str) -> dict[str, str]:
    """Return headers that have a browser save the answer under a name."""
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}


def _picture(found: Picture, if_none_match: str | None) -> Response:
    tag = f'"{found.version}"'
    # Browsers keep it, and ask whether it is still the newest.
    headers = {"ETag": tag, "Cache-Control": "private, no-cache"}
    if if_none_match == tag:
        return Response(status_code=304, headers=headers)
    return Response(found.data, media_type=found.media_type, headers=headers)


@router.get(
    "/jobs/{job_id}/preview", response_class=Response, responses={**refusals(404), **PNG, 204: {"description": "There is none yet."}}
)
def job_preview(who: Who, farm: TheFarm, job_id: JobId, if_none_match: IfNoneMatch = None) -> Response:
    """Show a small picture of a job: of its first frame that has one."""
    found = farm.pictures.job_preview(who, job_id)
    return Response(status_code=204) if found is None else _picture(found, if_none_match)


@router.get("/jobs/{job_id}/frames/{frame}/preview", response_class=Response, responses={**refusals(404), **PNG})
def preview(who: Who, farm: TheFarm, job_id: JobId, frame: FrameNumber, if_none_match: IfNoneMatch = None) -> Response:
    """Show the newest small picture of a frame."""
    return _picture(farm.pictures.preview(who, job_id, frame), if_none_match)


@router.get("/jobs/{job_id}/frames/{frame}/picture", response_class=Response, responses={**refusals(404), **PNG})
def picture(
    who: Who,
    farm: TheFarm,
    job_id: JobId,
    frame: FrameNumber,
    layer: Annotated[str, Query(min_length=1, max_length=100, pattern=PLAIN)] = "rgb",
    exposure: Exposure = 0.0,
    tonemap: Tonemap = "standard",
    size: Size = None,
    download: bool = False,
) -> Response:
    """Show a frame as it is now, as a PNG."""
    found = farm.pictures.develop(who, job_id, frame, layer=layer, exposure=exposure, tonemap=tonemap, size=size)
    headers = attachment(f"job-{job_id}-frame-{frame:04}-{layer}.png") if download else {}
    return Response(found.data, media_type=found.media_type, headers=headers)


@router.get("/jobs/{job_id}/frames/{frame}/layers", responses=refusals(404))
def layers(who: Who, farm: TheFarm, job_id: JobId, frame: FrameNumber) -> Layers:
    """List the layers of a frame; empty before its first unit is done."""
    return Layers(layers=farm.pictures.layers(who, job_id, frame))


@router.get(
    "/jobs/{job_id}/frames/{frame}/layers/{layer}",
    response_class=Response,
    responses={
        **refusals(404),
        204: {"description": "No unit is done yet."},
        200: {"content": {MEDIA_TYPE: {}}, "description": "Header and numbers, see etendue/console/wire.py."},
    },
)
def layer(
    who: Who, farm: TheFarm, job_id: JobId, frame: FrameNumber, layer: Layer, size: Size = 1600, if_none_match: IfNoneMatch = None
) -> Response:
    """Give a layer of a frame as it is now, as numbers: for the picture viewer."""
    if not farm.pictures.layers(who, job_id, frame):
        return Response(status_code=204)
    version, names, numbers = farm.pictures.layer(who, job_id, frame, layer, size=size)
    tag = f'"{version}-{layer}-{size}"' if layer.isascii() else f'"{version}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache"}
    if if_none_match == tag:
        return Response(status_code=304, headers=headers)
    data = encode_layer(layer, numbers, {"version": version, "layers": names, "job": job_id, "frame": frame})
    return Response(data, media_type=MEDIA_TYPE, headers=headers)


@router.get("/jobs/{job_id}/outputs", responses=refusals(404))
def outputs(who: Who, farm: TheFarm, job_id: JobId) -> list[Output]:
    """List the finished files of a job."""
    return farm.pictures.outputs(who, job_id)


@router.get("/jobs/{job_id}/outputs.zip", response_class=Response, responses={**refusals(404), 200: {"content": {"application/zip": {}}}})
def all_outputs(who: Who, farm: TheFarm, job_id: JobId) -> Response:
    """Download all finished files of a job as one zip, which is made on the way."""
    files = farm.pictures.outputs(who, job_id)
    if not files:
        raise NotFoundError(f"job {job_id} has no finished files yet")

    def chunks() -> Iterator[bytes]:
        pipe = _Pipe()
        # Pictures are compressed already.
        with zipfile.ZipFile(pipe, "w", zipfile.ZIP_STORED) as archive:
            for file in files:
                _, source = farm.pictures.open_output(who, job_id, file.name)
                with source, archive.open(zipfile.ZipInfo(file.name, (1980, 1, 1, 0, 0, 0)), "w", force_zip64=True) as entry:
                    while data := source.read(CHUNK):
                        entry.write(data)
                        yield pipe.take()
        yield pipe.take()

    return StreamingResponse(chunks(), media_type="application/zip", headers=attachment(f"job-{job_id}.zip"))


class _Pipe:
    """A file that is only written, and taken away as it comes: what ZipFile needs to stream."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: Buffer, /) -> int:
        self._parts.append(bytes(data))
        return len(self._parts[-1])

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Nothing is open."""

    def take(self) -> bytes:
        data = b"".join(self._parts)
        self._parts.clear()
        return data


@router.get(
    "/jobs/{job_id}/outputs/{name:path}",
    response_class=Response,
    responses={**refusals(404), 200: {"content": {"application/octet-stream": {}}}},
)
def output(who: Who, farm: TheFarm, job_id: JobId, name: Annotated[str, Path(min_length=1, max_length=1000, pattern=PLAIN)]) -> Response:
    """Download a finished file."""
    found, source = farm.pictures.open_output(who, job_id, name)
    headers = attachment(FilePath(found.name).name) | {"Content-Length": str(found.bytes)}
    return StreamingResponse(_read(source), media_type=TYPES.get(found.format, "application/octet-stream"), headers=headers)


def _read(source: IO[bytes]) -> Iterator[bytes]:
    with source:
        while data := source.read(CHUNK):
            yield data


@router.get("/jobs/{job_id}/movie.mp4", response_class=Response, responses={**refusals(404, 409), 200: {"content": {"video/mp4": {}}}})
def film(
    request: Request,
    who: Who,
    farm: TheFarm,
    job_id: JobId,
    fps: Annotated[float, Query(ge=1, le=120, description="Frames a second.")] = 24.0,
    exposure: Exposure = 0.0,
    tonemap: Tonemap = "standard",
    size: Annotated[int, Query(ge=16, le=3840, description="Longest edge in pixels.")] = 1920,
) -> Response:
    """Download the finished frames of an animation as a film (H.264)."""
    folder = tempfile.TemporaryDirectory(prefix="etendue-movie-")
    try:
        target = FilePath(folder.name) / "movie.mp4"
        movie.write(farm, who, job_id, target, fps=fps, exposure=exposure, tonemap=tonemap, size=size)
    except BaseException:
        folder.cleanup()
        raise
    return FileResponse(target, media_type="video/mp4", headers=attachment(f"job-{job_id}.mp4"), background=BackgroundTask(folder.cleanup))
