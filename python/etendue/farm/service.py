"""A farm's services: what the REST API, the console and the command line call.

```python
from etendue.farm.service import Farm

farm = Farm.open()
actor = farm.accounts.local()
package = farm.upload(actor, open("scene.zip", "rb"), "scene.zip")
job = farm.jobs.submit(actor, {"package": package.id, "settings": {"spp": 64}})
```

All functions may be called from several threads and processes at once. They only change the database and the store; the scheduler
(`etendue farm up`) does the work.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Literal

from sqlalchemy import func, select
from sqlalchemy.orm import Session

import etendue
from etendue.farm import charge, check, packages
from etendue.farm.accounts import Accounts, Actor
from etendue.farm.config import FarmConfig, default_root
from etendue.farm.database import Database
from etendue.farm.errors import ConflictError, FarmError, NotFoundError, QuotaError
from etendue.farm.events import audit
from etendue.farm.jobs import Jobs, check_page
from etendue.farm.models import Job, Node, Package, PackageUser, Unit, User
from etendue.farm.pictures import Pictures
from etendue.farm.states import JOB_ENDED, NodeState, Role, UnitState
from etendue.farm.store import Store
from etendue.farm.views import CostRow, FarmStatus, NodeView, PackageView, Page


class Farm:
    """A farm's database and store."""

    def __init__(self, root: Path, config: FarmConfig) -> None:
        self.root = root
        self.config = config
        self.database = Database(config.database_url(root))
        self.store = Store(config.store_url(root), config.store_options)
        self.accounts = Accounts(self.database)
        self.jobs = Jobs(self.database, self.store, config)
        self.pictures = Pictures(self.database, self.store, self.jobs)

    @classmethod
    def open(cls, root: Path | str | None = None, config: FarmConfig | None = None) -> Farm:
        """Open a farm; makes its folder and its tables where they are not there.

        Args:
            root: Its folder; None: `$ETENDUE_FARM`, else one in the user's folder for data.
            config: How it is set up; None: as `farm.json` in the folder says.
        """
        folder = Path(root) if root is not None else default_root()
        # Nobody else reads scenes and hashes of passwords.
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        return cls(folder, config or FarmConfig.load(folder))

    def close(self) -> None:
        """Close the database."""
        self.database.close()

    # ---- packages ----

    def upload(self, actor: Actor, data: IO[bytes], filename: str, *, scene: str | None = None) -> PackageView:
        """Take a scene with its files: a zip, or a single scene file.

        Args:
            actor: Who brings it.
            data: The upload; no more of it is read than is allowed.
            filename: Its name, for the ending.
            scene: The scene file in the zip; None: the only one, or the one nearest to the root.

        Returns:
            The package with its loss report in `info`. The same content has the same name and is kept once.

        Raises:
            PackageError: It is damaged, an attack, or no scene that can be read.
            TooLargeError: It is over a limit.
            QuotaError: The user's packages take too much room.
        """
        actor.need(Role.ARTIST)
        try:
            with packages.unpacked_upload(data, filename, self.config.limits) as (folder, found):
                return self._keep(actor, folder, found, filename, scene)
        except FarmError as e:
            with self.database.begin() as session:
                audit(session, actor.id, "package-refused", f"the upload {filename[:100]!a} of {actor.name} was refused: {e}")
            raise

    def add_folder(self, actor: Actor, folder: Path, paths: list[str], scene: str) -> PackageView:
        """Take files of a local folder as a package, without a zip in between."""
        actor.need(Role.ARTIST)
        return self._keep(actor, folder, packages.manifest(folder, paths, self.config.limits), scene, scene)

    def _keep(self, actor: Actor, folder: Path, found: packages.Manifest, filename: str, scene: str | None) -> PackageView:
        paths = [file.path for file in found.files]
        if scene is not None and scene not in paths:
            raise NotFoundError(f"the package has no file `{scene[:200]}`")
        scene = scene or packages.find_scene(paths)
        with self.database.read() as session:
            kept = session.get(Package, found.id)
            self._check_room(session, actor, found)
        # Another scene of the same files is read as well: its losses are its own.
        info = kept.info if kept is not None and kept.scene == scene else check.check_scene(folder, scene, self.config.limits)
        name = f"packages/{found.id}.zip"
        if kept is None or not self.store.exists(name):
            packed = folder.parent / f".{found.id}.zip"
            try:
                packages.write_zip(folder, found.files, packed)
                packed_bytes = packed.stat().st_size
                self.store.write_file(name, packed)
            finally:
                packed.unlink(missing_ok=True)
        else:
            packed_bytes = kept.packed_bytes
        with self.database.begin() as session:
            row = session.get(Package, found.id)
            if row is None:
                files = [list(file) for file in found.files]
                row = Package(id=found.id, scene=scene, bytes=found.bytes, packed_bytes=packed_bytes, files=files, info=info)
                session.add(row)
                session.flush()
            mine = session.get(PackageUser, (row.id, actor.id))
            if mine is None:
                mine = PackageUser(package_id=row.id, user_id=actor.id, name=filename[:256])
                session.add(mine)
            session.flush()
            audit(session, actor.id, "package-uploaded", f"{actor.name} uploaded {filename[:100]!a}: {row.id[:12]}")
            view = _package_view(row, mine)
        return view.model_copy(update={"scene": scene, "info": info})

    def _check_room(self, session: Session, actor: Actor, found: packages.Manifest) -> None:
        user = session.get_one(User, actor.id)
        if user.max_bytes is None or session.get(PackageUser, (found.id, actor.id)) is not None:
            return
        owned = select(func.sum(Package.bytes)).join(PackageUser, PackageUser.package_id == Package.id)
        used = session.scalar(owned.where(PackageUser.user_id == actor.id)) or 0
        if used + found.bytes > user.max_bytes:
            raise QuotaError(f"your packages may have {user.max_bytes} bytes; they would have {used + found.bytes}")

    def packages(self, actor: Actor, *, offset: int = 0, limit: int = 100) -> Page[PackageView]:
        """Return some of the packages that the user has uploaded, newest first."""
        offset, limit = check_page(offset, limit)
        with self.database.read() as session:
            query = (
                select(Package, PackageUser).join(PackageUser, PackageUser.package_id == Package.id).where(PackageUser.user_id == actor.id)
            )
            total = session.scalar(select(func.count()).select_from(PackageUser).where(PackageUser.user_id == actor.id)) or 0
            rows = session.execute(query.order_by(PackageUser.created_at.desc()).offset(offset).limit(limit)).all()
            return Page(items=[_package_view(row, mine) for row, mine in rows], total=total, offset=offset, limit=limit)

    def package(self, actor: Actor, package_id: str) -> PackageView:
        """Return a package of the user.

        Raises:
            NotFoundError: There is none of this name that the user has uploaded.
        """
        with self.database.read() as session:
            row, mine = session.get(Package, package_id), session.get(PackageUser, (package_id, actor.id))
            if row is None or mine is None:
                raise NotFoundError("there is no such package of yours")
            return _package_view(row, mine)

    def delete_package(self, actor: Actor, package_id: str) -> None:
        """Forget a package of the user; its files go when nobody has it.

        Raises:
            ConflictError: A job of the user needs it.
        """
        with self.database.begin() as session:
            mine = session.get(PackageUser, (package_id, actor.id))
            if mine is None:
                raise NotFoundError("there is no such package of yours")
            ended = [state.value for state in JOB_ENDED]
            needed = select(func.count()).select_from(Job).where(Job.package_id == package_id, Job.owner_id == actor.id)
            if session.scalar(needed.where(Job.state.not_in(ended))):
                raise ConflictError("a job that has not ended needs this package")
            session.delete(mine)
            session.flush()
            owners = session.scalar(select(func.count()).select_from(PackageUser).where(PackageUser.package_id == package_id))
            used = session.scalar(select(func.count()).select_from(Job).where(Job.package_id == package_id))
            if not owners and not used:
                session.delete(session.get_one(Package, package_id))
            audit(session, actor.id, "package-deleted", f"{actor.name} deleted the package {package_id[:12]}")
        if not owners and not used:
            self.store.delete(f"packages/{package_id}.zip")

    # ---- the farm ----

    def status(self, actor: Actor) -> FarmStatus:
        """Return the farm at a glance; the numbers of jobs are those that the user may see."""
        with self.database.read() as session:
            jobs = select(Job.state, func.count()).group_by(Job.state)
            if not actor.can(Role.ADMIN):
                jobs = jobs.where((Job.owner_id == actor.id) | Job.is_shared)
            states = {row[0]: row[1] for row in session.execute(jobs)}
            alive = select(func.count(), func.sum(Node.cores)).where(Node.state == NodeState.ALIVE.value)
            nodes, cores = session.execute(alive).one()
            ended = [state.value for state in JOB_ENDED]
            units = select(Unit.state, func.count()).join(Job, Unit.job_id == Job.id).where(Job.state.not_in(ended)).group_by(Unit.state)
            counts = {row[0]: row[1] for row in session.execute(units)}
            is_up = charge.is_held(session)
        return FarmStatus(
            is_up=is_up,
            nodes_alive=nodes,
            cores=float(cores or 0.0),
            jobs=states,
            units_queued=counts.get(UnitState.QUEUED.value, 0),
            units_running=counts.get(UnitState.RUNNING.value, 0),
            currency=self.config.currency,
            version=etendue.__version__,
        )

    def nodes(self, actor: Actor, *, alive: bool | None = None) -> list[NodeView]:
        """Return the nodes, those that work first. Everyone who may sign in may see them."""
        actor.need(Role.VIEWER)
        with self.database.read() as session:
            query = select(Node).order_by(Node.state, Node.name, Node.id)
            if alive is not None:
                query = query.where((Node.state == NodeState.ALIVE.value) == alive)
            return [NodeView.model_validate(row) for row in session.scalars(query)]

    def cost(
        self, actor: Actor, *, by: Literal["user", "job", "day"] = "job", after: float | None = None, before: float | None = None
    ) -> list[CostRow]:
        """Return what was spent, most first (days in order): of the user's own jobs, for administrators of all.

        Args:
            actor: Who asks.
            by: What to sum by.
            after: Only jobs that were submitted at this time or later.
            before: Only jobs that were submitted before.
        """
        query = select(Job.id, Job.name, User.name, Job.created_at, Job.units_done, Job.core_secs, Job.cost).join(User)
        if not actor.can(Role.ADMIN):
            query = query.where(Job.owner_id == actor.id)
        if after is not None:
            query = query.where(Job.created_at >= after)
        if before is not None:
            query = query.where(Job.created_at < before)
        keys: dict[str, Callable[[Any], str]] = {
            "user": lambda row: row[2],
            "job": lambda row: f"{row[0]} {row[1]}",
            "day": lambda row: time.strftime("%Y-%m-%d", time.gmtime(row[3])),
        }
        rows: dict[str, CostRow] = {}
        with self.database.read() as session:
            for row in session.execute(query):
                key = keys[by](row)
                sums = rows.setdefault(key, CostRow(key=key, jobs=0, units=0, core_secs=0.0, cost=0.0))
                sums.jobs += 1
                sums.units += row[4]
                sums.core_secs += row[5]
                sums.cost += row[6]
        ordered = (
            sorted(rows.values(), key=lambda r: r.key) if by == "day" else sorted(rows.values(), key=lambda r: (-r.cost, -r.core_secs))
        )
        return ordered


def _package_view(row: Package, mine: PackageUser) -> PackageView:
    keys = ("id", "scene", "bytes", "packed_bytes", "info")
    files = [(path, size, digest) for path, size, digest in row.files]
    return PackageView(name=mine.name, created_at=mine.created_at, files=files, **{key: getattr(row, key) for key in keys})
