"""The farm at a glance, its nodes, its cost, and uploaded packages."""

from __future__ import annotations

import tempfile
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

import etendue
from etendue.console.auth import TheFarm, TooOftenError, Who, console_of
from etendue.console.routes.parameters import PLAIN, Limit, Offset, Time, refusals
from etendue.farm.accounts import Actor
from etendue.farm.views import CostRow, FarmStatus, NodeView, PackageView, Page

router = APIRouter(tags=["farm"])

PackageId = Annotated[str, Path(pattern="^[0-9a-f]{64}$", description="Name of a package: a hash of its content.")]


class ParameterView(BaseModel):
    """A setting of the renderer."""

    name: str
    kind: str
    unit: str
    default: str
    doc: str


@router.get("/status", responses=refusals())
def status(who: Who, farm: TheFarm) -> FarmStatus:
    """Show the farm at a glance."""
    return farm.status(who)


@router.get("/nodes", responses=refusals(403))
def nodes(who: Who, farm: TheFarm, alive: bool | None = None) -> list[NodeView]:
    """List the nodes."""
    return farm.nodes(who, alive=alive)


@router.get("/cost", responses=refusals())
def cost(who: Who, farm: TheFarm, by: Literal["user", "job", "day"] = "job", after: Time = None, before: Time = None) -> list[CostRow]:
    """Sum up what was spent: on the user's own jobs, for administrators on all."""
    return farm.cost(who, by=by, after=after, before=before)


@router.get("/parameters", responses=refusals())
def parameters(who: Who) -> list[ParameterView]:
    """List the settings that a job may have."""
    return [ParameterView(**p._asdict()) for p in etendue.parameters()]


@router.get("/packages", responses=refusals())
def packages(who: Who, farm: TheFarm, offset: Offset = 0, limit: Limit = 100) -> Page[PackageView]:
    """List the packages that the user has uploaded."""
    return farm.packages(who, offset=offset, limit=limit)


def uploader(request: Request, who: Who) -> Actor:
    """Return who uploads, if it is not too often."""
    wait = console_of(request).uploads.take(f"user {who.id}")
    if wait > 0:
        raise TooOftenError(f"too many uploads; try again in {max(1, round(wait))} s", wait)
    return who


@router.post(
    "/packages",
    status_code=201,
    responses=refusals(403, 404, 413),
    openapi_extra={
        "requestBody": {"required": True, "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}
    },
)
async def upload(
    request: Request,
    farm: TheFarm,
    who: Annotated[Actor, Depends(uploader)],
    filename: Annotated[str, Query(min_length=1, max_length=255, pattern=PLAIN, description="Name of the file, for its ending.")],
    scene: Annotated[str | None, Query(max_length=1000, pattern=PLAIN, description="The scene file in a zip.")] = None,
) -> PackageView:
    """Upload a scene: a zip with all its files, or a single scene file, as the body. The answer has the loss report."""
    # To the disk as it comes: who may not upload was refused before the first byte was read.
    with tempfile.TemporaryFile(prefix="etendue-upload-") as file:
        async for chunk in request.stream():
            await run_in_threadpool(file.write, chunk)
        file.seek(0)
        return await run_in_threadpool(farm.upload, who, file, filename, scene=scene)


@router.get("/packages/{package_id}", responses=refusals(404))
def package(who: Who, farm: TheFarm, package_id: PackageId) -> PackageView:
    """Show a package with its loss report."""
    return farm.package(who, package_id)


@router.delete("/packages/{package_id}", status_code=204, responses=refusals(403, 404, 409))
def delete_package(who: Who, farm: TheFarm, package_id: PackageId) -> None:
    """Forget a package."""
    farm.delete_package(who, package_id)
