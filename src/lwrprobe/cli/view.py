"""`lwrprobe view RUN|SCENE|BAG`: look at it in the browser."""

from __future__ import annotations

import threading
from typing import Annotated

import typer


def view(
    source: Annotated[str, typer.Argument(help="Run folder, bag, scene file or built-in scene.", show_default=False)],
    port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="Port of the page; 0: a free one.")] = 8080,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Address of the page.")] = "127.0.0.1",
) -> None:
    """Show arm, probe, object, contacts and map in the browser; a recorded run has a time slider."""
    from lwrprobe.views.playback import playback
    from lwrprobe.views.viewer import Viewer

    viewer = Viewer(playback(source), host, port)
    typer.echo(f"{viewer.url} shows {source}; Ctrl-C ends")
    try:
        viewer.play(threading.Event())
    except KeyboardInterrupt:
        typer.echo("ended", err=True)
    finally:
        viewer.close()
