"""The arguments of `etendue farm`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

import etendue
from etendue.farm.spec import BakeSpec
from etendue.farm.states import JobState, Role

# Settings of the renderer that other flags of `submit` stand for.
_OWN = {"name", "frames", "crop", "aov", "priority"}


def parser(run: Mapping[str, Callable[[argparse.Namespace], int]]) -> argparse.ArgumentParser:
    """Return the parser of `etendue farm`.

    Args:
        run: What runs each command; set as `run` of the arguments.
    """
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--farm", metavar="FOLDER", help="the farm's folder [default: $ETENDUE_FARM, else one in your folder for data]")
    common.add_argument("--url", metavar="URL", help="the console of a farm elsewhere [default: $ETENDUE_FARM_URL, else the folder]")
    common.add_argument("--token-file", metavar="FILE", help="file with the API token for --url [default: $ETENDUE_FARM_TOKEN]")
    common.add_argument("--json", action="store_true", help="answers as JSON on standard output")
    common.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors and answers")
    top = argparse.ArgumentParser(prog="etendue farm", description="Render on many machines.")
    commands = top.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, text: str, *, job: bool = False) -> argparse.ArgumentParser:
        made = commands.add_parser(name, parents=[common], help=text, description=text)
        made.set_defaults(run=run[name])
        if job:
            made.add_argument("job", type=int, help="number of the job")
        return made

    up = command("up", "run the farm on this machine, or on a Ray cluster, until Ctrl-C")
    _add_cluster(up)
    up.add_argument("--host", default="127.0.0.1", help="address at which the console listens [default: 127.0.0.1, this machine alone]")
    up.add_argument("--port", type=int, help="port of the console; 0 takes a free one [default: 8640]")
    up.add_argument("--host-name", action="append", default=[], metavar="NAME", help="host name under which browsers reach the console")
    up.add_argument("--https", action="store_true", help="a proxy in front of the console speaks TLS")
    up.add_argument("--proxies", default="", metavar="ADDRESSES", help="proxies that may tell a client's address, with commas between")
    up.add_argument("--no-console", action="store_true", help="run the scheduler alone")
    _add_submit(command("submit", "order a picture or an animation"))
    status = command("status", "show the farm and its jobs, or one job with its frames")
    status.add_argument("job", type=int, nargs="?", help="number of a job")
    status.add_argument("--state", action="append", default=[], choices=[s.value for s in JobState], help="only jobs in this state")
    status.add_argument("--owner", help="only jobs of this user")
    status.add_argument("--text", help="only jobs with this in their name or scene")
    status.add_argument("--limit", type=int, default=50, help="most rows [default: 50]")
    wait = command("wait", "wait until a job ends or needs approval", job=True)
    wait.add_argument("--timeout", type=float, metavar="SECONDS", help="wait no longer")
    fetch = command("fetch", "copy a job's finished pictures here", job=True)
    fetch.add_argument("-o", "--output", default=".", metavar="FOLDER", help="where to [default: here]")
    fetch.add_argument("--frame", type=int, help="only of this frame")
    command("cancel", "end a job; what is done stays", job=True)
    command("pause", "begin no more units of a job", job=True)
    command("resume", "go on with a paused job", job=True)
    command("approve", "let the frames go that wait for approval", job=True)
    retry = command("retry", "try again what has failed or was cancelled", job=True)
    retry.add_argument("--frame", type=int, help="only of this frame")
    retry.add_argument("--unit", type=int, help="only this unit")
    priority = command("priority", "change a job's priority", job=True)
    priority.add_argument("priority", type=int, help="-100 to 100; higher goes first")
    command("delete", "delete a job that has ended, with its films and pictures", job=True)
    export = command("export", "write a job as an Open Job Description template", job=True)
    export.add_argument("-o", "--output", metavar="FILE", help="where to [default: standard output]")
    importing = command("import", "order what an Open Job Description template renders")
    importing.add_argument("template", help="YAML or JSON; its steps run `etendue render`")
    importing.add_argument("-p", "--parameter", action="append", default=[], type=_define, metavar="NAME=VALUE", help="of the template")
    importing.add_argument("--include", action="append", default=[], metavar="PATTERN", help="as of `submit`")
    importing.add_argument("--all", action="store_true", help="all files of the scenes' folders")
    importing.add_argument("--priority", type=int, default=0, help="-100 to 100; higher goes first")
    nodes = command("nodes", "show the machines")
    nodes.add_argument("--all", action="store_true", help="those that are gone as well")
    log = command("log", "show what has happened")
    log.add_argument("job", type=int, nargs="?", help="number of a job")
    log.add_argument("--limit", type=int, default=50, help="most lines [default: 50]")
    cost = command("cost", "show what was spent")
    cost.add_argument("--by", choices=["user", "job", "day"], default="job", help="what to sum by [default: job]")
    user = command("user", "users of the console and the API")
    user.add_argument("action", choices=["list", "add", "passwd", "token"], help="passwords are read from standard input")
    user.add_argument("name", nargs="?", help="the user")
    user.add_argument("--role", choices=[r.value for r in Role], default=Role.ARTIST.value, help="of a new user [default: artist]")
    user.add_argument("--days", type=float, help="how long a token is valid")
    return top


def _add_cluster(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--address", help="join the Ray cluster at this address, such as auto [default: start one on this machine]")
    parser.add_argument("--cores", type=int, help="cores of the cluster that is started [default: all]")


def _add_submit(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", help="the scene file; files that it names in its folder go with it")
    add(
        "-o",
        "--output",
        action="append",
        default=[],
        metavar="FILE",
        help="with --wait: write the picture here; may be given several times",
    )
    add("--wait", action="store_true", help="wait for the end; where no farm is running, one is started for this job")
    add("--name", help="what the list of jobs shows")
    add("--include", action="append", default=[], metavar="PATTERN", help="further files of the scene's folder, such as 'maps/*.png'")
    add("--all", action="store_true", help="all files of the scene's folder")
    add("-D", "--define", action="append", default=[], type=_define, metavar="KEY=VALUE", help="as of `etendue render`")
    add("--variant", help="material variant of a glTF file")
    add("--gltf-scene", help="scene of a glTF file")
    add("--gltf-animation", help="animation of a glTF file, by name or number [default: the first]")
    add("--crop", type=_numbers(int, 4), metavar="X0,Y0,X1,Y1", help="only these pixels")
    add("--aov", action="append", default=[], metavar="NAMES", help="auxiliary outputs, as of `etendue render`")
    add(
        "--command", choices=["render", "bake", "photons"], help="what to make [default: bake for -o FILE.glb, photons for -o FILE.photons]"
    )
    add(
        "--study",
        action="append",
        default=[],
        type=_define,
        metavar="SETTING=VALUES",
        help="a picture for each value, such as integrator=path,bdpt; given several times, for each combination",
    )
    add("--frames", metavar="LIST", help="frames of an animation: 1-48, 1-100x5, 1,4,10-12")
    add("--last-frame", type=int, metavar="N", help="the animation's last frame, where --frames does not go up to it")
    add(
        "--clocks",
        type=_numbers(float, 2),
        default=(0.0, 1.0),
        metavar="FIRST,LAST",
        help="`clock` (seconds of a glTF animation) of frame 1 and the last [default: 0,1]",
    )
    add("--format", default="", metavar="NAMES", help="files to make: exr, png, jpg, hdr, pfm, film [default: exr, or as -o]")
    add("--exposure", type=float, default=0.0, help="of PNG and JPEG, in stops")
    add("--tonemap", default="standard", help="of PNG and JPEG: standard, filmic, aces, agx")
    add("--noise", type=float, metavar="ERROR", help="stop a frame at this relative error")
    add("--time", type=float, metavar="SECONDS", help="stop the job after this time, with what it has")
    add("--core-hours", type=float, metavar="HOURS", help="stop the job after so many core-hours, with what it has")
    add("--cost", type=float, metavar="AMOUNT", help="stop the job at this cost, with what it has")
    add("--every-first", type=int, metavar="N", help="every Nth frame first")
    add("--approval", action="store_true", help="wait for `etendue farm approve` after those")
    add("--priority", type=int, default=0, help="-100 to 100; higher goes first")
    add("--shared", action="store_true", help="let all users look at it")
    add("--needs", action="append", default=[], type=int, metavar="JOB", help="begin when this job is done")
    add("--notify", metavar="URL", help="POST the job there when it ends")
    add("--unit-secs", type=float, metavar="SECONDS", help="length of a unit [default: 10 to 60]")
    _add_cluster(parser)
    group = parser.add_argument_group("baking, as of `etendue bake`")
    for name, field in BakeSpec.model_fields.items():
        flag, about = "--" + name.replace("_", "-"), (field.description or "").replace("%", "%%")
        if field.annotation is bool:
            group.add_argument(flag, dest=f"bake_{name}", action="store_true", default=None, help=about)
        elif name == "probes":
            group.add_argument(flag, dest=f"bake_{name}", type=_numbers(int, 3), metavar="NX,NY,NZ", help=about)
        else:
            group.add_argument(flag, dest=f"bake_{name}", metavar="VALUE", help=about)
    group = parser.add_argument_group("settings of the renderer")
    for parameter in etendue.parameters():
        if parameter.name not in _OWN:
            flag = "--" + parameter.name.replace("_", "-")
            is_switch = parameter.kind.startswith(("bool", "switch"))
            more: dict[str, Any] = {"nargs": "?", "const": "true"} if is_switch else {}
            help_text = parameter.doc.replace("%", "%%")
            group.add_argument(flag, dest=f"set_{parameter.name}", metavar="VALUE", help=help_text, **more)


def _define(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not key or not equals:
        raise argparse.ArgumentTypeError("expected KEY=VALUE")
    return key, value


def _numbers(kind: type[int] | type[float], count: int) -> Callable[[str], tuple[float, ...]]:
    def parse(text: str) -> tuple[float, ...]:
        try:
            numbers = tuple(kind(part) for part in text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != count:
            raise argparse.ArgumentTypeError(f"expected {count} numbers with commas between them")
        return numbers

    return parse
