"""`etendue farm …`: the farm from the command line. Exit codes are in docs/guide/exit-codes.md."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import os
import secrets
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import etendue
from etendue.farm import arguments, charge, collect, openjd, runner
from etendue.farm.accounts import Actor
from etendue.farm.errors import FarmError, InvalidError
from etendue.farm.jobs import JobFilter, check_spec
from etendue.farm.remote import RemoteFarm
from etendue.farm.service import Farm
from etendue.farm.spec import MAX_RUNS, BakeSpec, JobSpec, Setting
from etendue.farm.states import JOB_ENDED, JobState, Role
from etendue.farm.views import JobDetail, JobView, View

EXIT_FAILED, EXIT_CANCELLED, EXIT_APPROVAL, EXIT_TIMEOUT, EXIT_INTERRUPTED = 20, 21, 22, 23, 130
_BY_STATE = {JobState.DONE: 0, JobState.FAILED: EXIT_FAILED, JobState.CANCELLED: EXIT_CANCELLED, JobState.APPROVAL: EXIT_APPROVAL}


def main(argv: list[str]) -> int:
    """Run `etendue farm` with these arguments and return the exit code."""
    run = {name: _steer(name) for name in ("cancel", "pause", "resume", "approve", "retry", "priority")}
    run |= {
        "up": _up,
        "submit": _submit,
        "status": _status,
        "wait": _wait,
        "fetch": _fetch,
        "delete": _delete,
        "nodes": _nodes,
        "log": _log,
    }
    run |= {"cost": _cost, "user": _user, "export": _export, "import": _import}
    args = arguments.parser(run).parse_args(argv)
    try:
        return int(args.run(args))
    except FarmError as e:
        return _fail(args, e.code, str(e), e.exit_code)
    except (etendue.SceneError, etendue.UnsupportedError) as e:
        return _fail(args, "scene", str(e), 3)
    except OSError as e:
        return _fail(args, "io", str(e), 4)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def _fail(args: argparse.Namespace, code: str, message: str, exit_code: int) -> int:
    if args.json:
        print(json.dumps({"error": {"code": code, "message": message}}))
    print(f"etendue farm: error: {message}", file=sys.stderr)
    return exit_code


# ---- up ----


def _up(args: argparse.Namespace) -> int:
    with _own_farm(args) as farm:
        _check_free(farm)
        backend = runner.ray_backend(farm, args.address, args.cores)
        with _terminated(), runner.running(farm, backend) as scheduler, _console(args, farm):
            _say(f"The farm is up: {farm.root}. Ctrl-C stops it; jobs go on with the next `etendue farm up`.")
            with contextlib.suppress(KeyboardInterrupt):
                while scheduler.thread is not None and scheduler.thread.is_alive():
                    scheduler.thread.join(0.5)
    return 0


@contextlib.contextmanager
def _console(args: argparse.Namespace, farm: Farm) -> Iterator[None]:
    """Serve the console, and print the address that lets its reader in as `local`."""
    if args.no_console:
        yield
        return
    try:
        from etendue.console import serve
        from etendue.console.settings import ConsoleSettings
    except ModuleNotFoundError as e:
        raise FarmError(f'the console needs the Python package `{e.name}`: pip install "etendue[console]", or --no-console') from e
    is_local = args.host in ("127.0.0.1", "localhost", "::1")
    # The key is for who sits at this machine. Who comes from elsewhere has a name and a password.
    key = secrets.token_urlsafe(24) if is_local and not args.host_name else None
    hosts = [*ConsoleSettings().hosts, args.host, *args.host_name] if is_local or args.host_name else ["*"]
    settings = ConsoleSettings(hosts=hosts, is_https=args.https, local_key=key)
    port = serve.DEFAULT_PORT if args.port is None else args.port
    with serve.running(farm, settings, args.host, port, args.proxies) as address:
        _say(f"The console is at {address}/enter?key={key}" if key else f"The console is at {address}")
        yield


@contextlib.contextmanager
def _terminated() -> Iterator[None]:
    """Let SIGTERM, as from service managers, end the farm as Ctrl-C does. Once: a second one does not disturb the end."""
    told = False

    def stop(_number: int, _frame: object) -> None:
        nonlocal told
        if not told:
            told = True
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _check_free(farm: Farm) -> None:
    with farm.database.read() as session:
        if charge.is_held(session):
            _say("note: the last scheduler of this farm was at work a moment ago")


# ---- submit ----


def _submit(args: argparse.Namespace) -> int:
    scene = Path(args.scene)
    formats, target = _targets(args)
    raw = etendue.load(scene, defines=dict(args.define), variant=args.variant, scene=args.gltf_scene)
    folder, paths = collect.scene_files(scene, raw.info()["files"], args.include, everything=args.all)
    for loss in raw.losses[: 0 if args.quiet else 10]:
        _say(f"{loss.file}:{loss.line or 0}: {loss.feature}: {loss.effect}")
    with _farm(args) as (farm, actor), contextlib.ExitStack() as stack:
        package = farm.add_folder(actor, folder, paths, scene.name)
        job = farm.jobs.submit(actor, _spec(args, package.id, scene.name, formats))
        if not args.quiet:
            _say(f"job {job.id}: `{job.name}`, {job.frames_total} frame(s), {len(paths)} file(s), package {package.id[:12]}")
        if not args.wait:
            _print(args, job, lambda: str(job.id))
            return 0
        is_up = farm.status(actor).is_up
        if isinstance(farm, RemoteFarm):
            if not is_up:
                _say("the console is there, but its farm is not running: the job waits until it is")
            # Others keep that farm going.
            is_up = True
        elif not is_up:
            if not args.quiet:
                _say("no farm is running: one is started for this job")
            stack.enter_context(runner.running(farm, runner.ray_backend(farm, args.address, args.cores)))
        try:
            job = _wait_for(farm, actor, job.id, None, quiet=args.quiet)
        except KeyboardInterrupt:
            if not is_up:
                # Nobody would go on with it.
                farm.jobs.cancel(actor, job.id)
            raise
        code = _BY_STATE[JobState(job.state)]
        if code == 0:
            _write_outputs(farm, actor, job, target, quiet=args.quiet)
        else:
            _say(f"job {job.id} is {job.state}" + (f": {job.error}" if job.error else ""))
    if args.json:
        print(job.model_dump_json())
    return code


def _targets(args: argparse.Namespace) -> tuple[list[str], list[Path]]:
    """Return the formats to make, and where the pictures go (nowhere without `-o`)."""
    target = [Path(path) for path in args.output]
    formats = [path.suffix.lower().lstrip(".") or "?" for path in target] or [f for f in args.format.split(",") if f]
    for path in target:
        if not path.resolve().parent.is_dir():
            raise InvalidError(f"{path}: there is no folder {path.parent}")
    formats = ["jpg" if f == "jpeg" else f for f in formats]
    return list(dict.fromkeys(formats)), target


def _spec(args: argparse.Namespace, package: str, scene: str, formats: list[str]) -> JobSpec:
    settings: dict[str, Setting] = {}
    for parameter in etendue.parameters():
        value = getattr(args, f"set_{parameter.name}", None)
        if value is not None:
            settings[parameter.name] = openjd.setting(value)
    stop = {"noise": args.noise, "secs": args.time, "cost": args.cost}
    stop["core_secs"] = None if args.core_hours is None else args.core_hours * 3600.0
    kinds = {"glb": "bake", "photons": "photons"}
    command = args.command or next((kinds[f] for f in formats if f in kinds), "render")
    if args.study:
        if command != "render":
            raise InvalidError("a study makes pictures")
        command = "study"
    bake = {name: value for name in BakeSpec.model_fields if (value := getattr(args, f"bake_{name}")) is not None}
    content: dict[str, Any] = {
        "package": package,
        "scene": scene,
        "name": args.name or "",
        "settings": settings,
        "crop": args.crop,
        "aovs": [name for names in args.aov for name in names.split(",") if name],
        "defines": dict(args.define),
        "variant": args.variant,
        "gltf_scene": args.gltf_scene,
        "gltf_animation": args.gltf_animation,
        "command": command,
        "bake": bake,
        "runs": _runs(args.study),
        "frames": args.frames,
        "last_frame": args.last_frame,
        "clocks": args.clocks,
        "formats": formats,
        "exposure": args.exposure,
        "tonemap": args.tonemap,
        "stop": stop,
        "every_first": args.every_first,
        "approval": args.approval,
        "priority": args.priority,
        "shared": args.shared,
        "needs": args.needs,
        "notify": args.notify,
        "unit_secs": args.unit_secs,
    }
    return check_spec(content)


def _runs(axes: list[tuple[str, str]]) -> list[dict[str, Setting]]:
    """Return all combinations of the values that the axes of a study have; the last axis changes fastest."""
    if not axes:
        return []
    values = [[openjd.setting(v) for v in text.split(",") if v] for _, text in axes]
    count = math.prod(map(len, values))
    if not 1 <= count <= MAX_RUNS:
        raise InvalidError(f"a study has 1 to {MAX_RUNS} runs, not {count}")
    names = [name.replace("-", "_") for name, _ in axes]
    return [dict(zip(names, run, strict=True)) for run in itertools.product(*values)]


def _write_outputs(farm: Farm | RemoteFarm, actor: Actor, job: JobView, target: list[Path], *, quiet: bool) -> list[Path]:
    """Write the job's pictures; those of an animation get the frame's number before the ending."""
    written = []
    by_format = {("jpg" if p.suffix.lower() == ".jpeg" else p.suffix.lower().lstrip(".")): p for p in target}
    outputs = farm.pictures.outputs(actor, job.id)
    baked = next((o.name.removesuffix(".glb") for o in outputs if o.format == "glb"), None)
    for output in outputs:
        path = by_format.get(output.format)
        if path is None and baked is not None and target:
            # What goes beside the baked scene keeps its ending.
            path = target[0].with_suffix(output.name.removeprefix(baked))
        if path is None:
            continue
        if job.kind in ("animation", "study"):
            path = path.with_name(f"{path.stem}.{output.frame:04d}{path.suffix}")
        _copy_output(farm, actor, job.id, output.name, path)
        written.append(path)
        if not quiet:
            _say(str(path))
    return written


def _copy_output(farm: Farm | RemoteFarm, actor: Actor, job: int, name: str, path: Path) -> None:
    _, data = farm.pictures.open_output(actor, job, name)
    with data, tempfile.NamedTemporaryFile(dir=path.resolve().parent, prefix=".etendue-", delete=False) as part:
        try:
            while chunk := data.read(1 << 20):
                part.write(chunk)
            part.close()
            Path(part.name).chmod(0o644)
            Path(part.name).replace(path)
        except BaseException:
            Path(part.name).unlink(missing_ok=True)
            raise


# ---- templates ----


def _export(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        job = farm.jobs.get(actor, args.job)
        template = openjd.export_job(JobSpec.model_validate(job.spec), job.scene, job.name)
    text = json.dumps(template, indent=2) + "\n"
    if args.output is None:
        print(text, end="")
    else:
        Path(args.output).write_text(text, encoding="utf-8")
    return 0


def _import(args: argparse.Namespace) -> int:
    steps = openjd.import_template(Path(args.template), dict(args.parameter))
    made: dict[str, JobDetail] = {}
    with _farm(args) as (farm, actor):
        for step in steps:
            raw = etendue.load(
                step.scene, defines=dict(step.order["defines"]), variant=step.order["variant"], scene=step.order["gltf_scene"]
            )
            folder, paths = collect.scene_files(step.scene, raw.info()["files"], args.include, everything=args.all)
            package = farm.add_folder(actor, folder, paths, step.scene.name)
            needs = [made[name].id for name in step.needs]
            order = {**step.order, "package": package.id, "scene": step.scene.name, "needs": needs, "priority": args.priority}
            made[step.step] = farm.jobs.submit(actor, check_spec(order))
            if not args.quiet:
                job = made[step.step]
                _say(f"job {job.id}: `{job.name}`, {job.frames_total} frame(s)")
        _print(args, {name: job.id for name, job in made.items()}, lambda: "\n".join(str(job.id) for job in made.values()))
    return 0


# ---- waiting and fetching ----


def _wait(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        job = _wait_for(farm, actor, args.job, args.timeout, quiet=args.quiet)
        _print(args, job, lambda: f"job {job.id} is {job.state}" + (f": {job.error}" if job.error else ""))
        return _BY_STATE.get(JobState(job.state), EXIT_TIMEOUT)


def _wait_for(farm: Farm | RemoteFarm, actor: Actor, job_id: int, timeout: float | None, *, quiet: bool) -> JobDetail:
    """Return a job when it has ended, waits for approval, or the time is over."""
    end = None if timeout is None else time.monotonic() + timeout
    shown = ""
    is_terminal = sys.stderr.isatty()
    while True:
        job = farm.jobs.get(actor, job_id)
        over = JobState(job.state) in (*JOB_ENDED, JobState.APPROVAL) or (end is not None and time.monotonic() >= end)
        line = f"{job.state}: {job.progress:6.1%}, {job.frames_done}/{job.frames_total} frames, {job.units_done}/{job.units_total} units"
        if not quiet and is_terminal and line != shown:
            print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)
            shown = line
        if over:
            if shown:
                print(file=sys.stderr)
            return job
        time.sleep(0.2)


def _fetch(args: argparse.Namespace) -> int:
    folder = Path(args.output)
    with _farm(args) as (farm, actor):
        outputs = farm.pictures.outputs(actor, args.job)
        wanted = [o for o in outputs if args.frame is None or o.frame == args.frame]
        if not wanted:
            raise InvalidError(f"job {args.job} has no finished pictures yet")
        folder.mkdir(parents=True, exist_ok=True)
        for output in wanted:
            _copy_output(farm, actor, args.job, output.name, folder / output.name)
        _print(args, [o.model_dump() for o in wanted], lambda: "\n".join(str(folder / o.name) for o in wanted))
    return 0


# ---- looking and steering ----


def _status(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        if args.job is not None:
            job = farm.jobs.get(actor, args.job)
            frames = farm.jobs.frames(actor, job.id, limit=args.limit)
            _print(args, {**job.model_dump(), "frames": [f.model_dump() for f in frames.items]}, lambda: _job_text(job, frames.items))
            return 0
        states = [JobState(state) for state in args.state] or None
        jobs = farm.jobs.find(actor, JobFilter(states=states, owner=args.owner, text=args.text), limit=args.limit)
        status = farm.status(actor)
        up = f"up: {status.nodes_alive} node(s), {status.cores:g} cores" if status.is_up else "not running"
        rows = [["JOB", "NAME", "OWNER", "STATE", "FRAMES", "PROGRESS", "PRIO", "CORE-S"]]
        for j in jobs.items:
            frames_text = f"{j.frames_done}/{j.frames_total}"
            rows.append([str(j.id), j.name, j.owner, j.state, frames_text, f"{j.progress:.0%}", str(j.priority), f"{j.core_secs:.0f}"])
        text = f"The farm is {up}.\n" + _table(rows) + (f"\n{jobs.total} jobs in all" if jobs.total > len(jobs.items) else "")
        _print(args, {"farm": status.model_dump(), **jobs.model_dump()}, lambda: text)
    return 0


def _job_text(job: JobDetail, frames: list[Any]) -> str:
    lines = [f"job {job.id} `{job.name}` of {job.owner}: {job.state}, {job.progress:.1%}" + (f": {job.error}" if job.error else "")]
    spent = f"{job.core_secs:.1f} core-seconds"
    if job.estimated_core_secs is not None:
        spent += f" of about {job.estimated_core_secs:.1f}"
    lines.append(f"{job.units_done}/{job.units_total} units, {spent}, cost {job.cost:.4f}, priority {job.priority}")
    rows = [["FRAME", "STATE", "UNITS", "SPP", "ERROR"]]
    for f in frames:
        error = f.error or ("" if f.relative_error is None else f"{f.relative_error:.4f}")
        rows.append([str(f.number), f.state, f"{f.units_done}/{f.units_total}", str(f.spp_done), error])
    return "\n".join([*lines, _table(rows)])


def _steer(name: str) -> Callable[[argparse.Namespace], int]:
    def run(args: argparse.Namespace) -> int:
        with _farm(args) as (farm, actor):
            if name == "priority":
                job = farm.jobs.set_priority(actor, args.job, args.priority)
            elif name == "retry":
                job = farm.jobs.retry(actor, args.job, frame=args.frame, unit=args.unit)
            else:
                job = cast(JobDetail, getattr(farm.jobs, name)(actor, args.job))
            _print(args, job, lambda: f"job {job.id} is {job.state}, priority {job.priority}")
        return 0

    return run


def _delete(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        farm.jobs.delete(actor, args.job)
        _print(args, {"deleted": args.job}, lambda: f"job {args.job} is deleted")
    return 0


def _nodes(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        nodes = farm.nodes(actor, alive=None if args.all else True)
        rows = [["NODE", "STATE", "CORES", "LOAD", "MEMORY", "RUNNING", "UNITS", "CORE-S"]]
        for n in nodes:
            memory = f"{n.memory_used_bytes / 2**30:.1f}/{n.memory_bytes / 2**30:.1f} GiB"
            rows.append([n.name, n.state, f"{n.cores:g}", f"{n.load:.1f}", memory, str(n.running), str(n.units_done), f"{n.core_secs:.0f}"])
        _print(args, [n.model_dump() for n in nodes], lambda: _table(rows))
    return 0


def _log(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        page = farm.jobs.log(actor, job=args.job, limit=args.limit)
        lines = [f"{_time(e.at)} {e.level:7} {e.kind}: {e.message}" for e in reversed(page.items)]
        _print(args, page, lambda: "\n".join(lines))
    return 0


def _cost(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        found = farm.cost(actor, by=args.by)
        rows = [[args.by.upper(), "JOBS", "UNITS", "CORE-HOURS", f"COST ({farm.status(actor).currency})"]]
        rows += [[r.key, str(r.jobs), str(r.units), f"{r.core_secs / 3600:.3f}", f"{r.cost:.4f}"] for r in found]
        _print(args, [r.model_dump() for r in found], lambda: _table(rows))
    return 0


def _user(args: argparse.Namespace) -> int:
    with _farm(args) as (farm, actor):
        if args.action == "list":
            users = farm.accounts.users(actor)
            rows = [["USER", "ROLE", "SHARE", "ACTIVE"], *([u.name, u.role, f"{u.share:g}", str(u.is_active)] for u in users)]
            _print(args, [u.model_dump() for u in users], lambda: _table(rows))
            return 0
        if args.name is None:
            raise InvalidError(f"`user {args.action}` takes a name")
        if args.action == "token":
            text = farm.accounts.create_token(actor, "command line", days=args.days, user=args.name)
            _print(args, {"token": text}, lambda: text)
            return 0
        # From standard input, as arguments are seen by everyone on the machine.
        password = _password()
        if args.action == "add":
            user = farm.accounts.create(actor, args.name, password=password, role=Role(args.role))
        else:
            user = farm.accounts.update(actor, args.name, password=password)
        _print(args, user, lambda: f"{user.name}: {user.role}")
    return 0


def _password() -> str:
    if sys.stdin.isatty():
        import getpass

        return getpass.getpass("Password: ")
    return sys.stdin.readline().rstrip("\r\n")


# ---- talking ----


@contextlib.contextmanager
def _farm(args: argparse.Namespace) -> Iterator[tuple[Farm | RemoteFarm, Actor]]:
    """Open the farm that the arguments name: behind a console's address, or in a folder."""
    url = _url(args)
    farm: Farm | RemoteFarm = RemoteFarm(url, _token(args)) if url else Farm.open(args.farm)
    try:
        yield farm, farm.accounts.local()
    finally:
        farm.close()


@contextlib.contextmanager
def _own_farm(args: argparse.Namespace) -> Iterator[Farm]:
    if args.url:
        raise InvalidError("a farm is run beside its folder: `up` takes no --url")
    farm = Farm.open(args.farm)
    try:
        yield farm
    finally:
        farm.close()


def _url(args: argparse.Namespace) -> str | None:
    # A folder that is named on the command line is meant, whatever the environment says.
    return args.url or (None if args.farm else os.environ.get("ETENDUE_FARM_URL")) or None


def _token(args: argparse.Namespace) -> str:
    # Never as an argument: those are seen by everyone on the machine.
    if args.token_file is not None:
        return Path(args.token_file).read_text(encoding="utf-8").strip()
    return os.environ.get("ETENDUE_FARM_TOKEN", "").strip()


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _print(args: argparse.Namespace, value: object, text: Callable[[], str]) -> None:
    if not args.json:
        print(text())
    elif isinstance(value, View):
        print(value.model_dump_json())
    else:
        print(json.dumps(value))


def _time(at: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))


def _table(rows: list[list[str]]) -> str:
    clean = [["".join(c if c.isprintable() else "?" for c in cell)[:60] for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in clean) for i in range(len(clean[0]))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in clean)
