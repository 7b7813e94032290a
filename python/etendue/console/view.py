"""The command `etendue view SCENE`."""

from __future__ import annotations

import argparse
import secrets
import socket
import sys
import webbrowser
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import etendue

EXIT_FAILURE, EXIT_INVALID, EXIT_IO = 1, 3, 4
"""As docs/guide/exit-codes.md lists them."""


def parser() -> argparse.ArgumentParser:
    """Return the command's arguments."""
    p = argparse.ArgumentParser(
        prog="etendue view",
        description="Look at a scene in the browser: a picture that sharpens while the camera is moved.",
        epilog="The page is for this machine alone. Ctrl-C ends it.",
    )
    p.add_argument("scene", type=Path, help="scene file: .xml, .pov, .pbrt, .gltf, .glb, .obj, .ply, .stl")
    p.add_argument("-L", "--search-path", action="append", default=[], type=Path, help="folder in which the scene may read files")
    p.add_argument("-D", "--define", action="append", default=[], metavar="KEY=VALUE", help="value for $KEY in a Mitsuba file")
    p.add_argument("--variant", help="material variant of a glTF file")
    p.add_argument("--gltf-scene", metavar="NAME", help="scene of a glTF file, by name or number")
    p.add_argument("--gltf-animation", metavar="NAME", help="animation of a glTF file, by name or number")
    p.add_argument("--clock", type=float, metavar="NUMBER", help="second of a glTF file's animation, or clock of a POV-Ray scene")
    p.add_argument("--width", type=int, help="width of the picture in pixels")
    p.add_argument("--height", type=int, help="height of the picture in pixels")
    p.add_argument("--spp", type=int, help="samples per pixel at which the picture stops [default: 1024; POV-Ray scenes: antialiasing]")
    p.add_argument("--integrator", help="how light is computed")
    p.add_argument("--camera", help="name or number of the camera")
    p.add_argument("--threads", type=int, default=0, help="threads [default: all cores]")
    p.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 [default: a free one]")
    p.add_argument("--no-browser", action="store_true", help="print the address and open nothing")
    p.add_argument("--no-watch", action="store_true", help="do not read the scene again when its files change")
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    args = parser().parse_args(argv)
    try:
        import uvicorn

        from etendue.console.live import Live, Look
        from etendue.console.viewer import Viewers, create_app
    except ImportError as e:
        sys.stderr.write(f'etendue view needs a package that is not installed ({e.name}): pip install "etendue[console]"\n')
        return EXIT_FAILURE
    defines = dict(text.partition("=")[::2] for text in args.define)
    load = partial(
        etendue.load,
        args.scene,
        args.search_path,
        defines,
        args.variant,
        scene=args.gltf_scene,
        animation=args.gltf_animation,
        clock=args.clock,
    )
    viewers = Viewers()
    try:
        scene = load()
        spp = args.spp or (None if scene.info()["format"] == "pov" else 1024)
        names = {"width": args.width, "height": args.height, "spp": spp, "integrator": args.integrator, "camera": args.camera}
        live = Live(load, Look(settings=names), viewers.tell, scene=scene, watch=not args.no_watch, threads=args.threads)
    except OSError as e:
        sys.stderr.write(f"etendue: error: {e}\n")
        return EXIT_IO
    except etendue.Error as e:
        sys.stderr.write(f"{e}\n")
        return EXIT_INVALID
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(("127.0.0.1", args.port))
        except OSError as e:
            sys.stderr.write(f"etendue: error: port {args.port}: {e.strerror}\n")
            return EXIT_IO
        # Whoever reads the address may come at once.
        listener.listen(64)
        port = listener.getsockname()[1]
        token = secrets.token_urlsafe(24)
        hosts = frozenset({f"127.0.0.1:{port}", f"localhost:{port}"})
        app = create_app(live, viewers, token, hosts, args.scene.name)
        address = f"http://127.0.0.1:{port}/?token={token}"
        sys.stdout.write(f"{args.scene.name} is at {address}\nCtrl-C ends it.\n")
        sys.stdout.flush()
        if not args.no_browser:
            webbrowser.open(address)
        # The access log would hold the token.
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, ws_per_message_deflate=False, lifespan="on", timeout_graceful_shutdown=2
        )
        server = uvicorn.Server(config)
        server.run(sockets=[listener])
    return 0
