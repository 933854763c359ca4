"""The commands of ``depth-pose``.

Each command's module imports its dependencies inside the command, so that help is quick.
"""

from __future__ import annotations

import logging
import sys
from io import TextIOWrapper

import typer

from depth_pose import __version__
from depth_pose.cli.banks import app as bank_app
from depth_pose.cli.console import console, tell_error, unwrap_help
from depth_pose.cli.damage import LENIENT_HELP, be_lenient, exit_on_damage
from depth_pose.cli.export import add_to as add_export
from depth_pose.cli.fusion import add_to as add_fusion
from depth_pose.cli.info import add_to as add_info
from depth_pose.cli.live import add_to as add_live
from depth_pose.cli.look import add_to as add_look
from depth_pose.cli.report import add_to as add_report
from depth_pose.cli.rooms import add_to as add_rooms
from depth_pose.cli.run import add_to as add_run
from depth_pose.cli.scoring import add_to as add_scoring
from depth_pose.cli.settings import add_to as add_settings
from depth_pose.cli.simulation import add_to as add_simulation
from depth_pose.cli.view import add_to as add_view
from depth_pose.cli.volume import app as volume_app
from depth_pose.core.errors import ConfigError, DepthPoseError, raise_if_interrupted
from depth_pose.core.printable import printable_lines

app = typer.Typer(
    name="depth-pose",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(__version__)
        raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(
        False, "--version", is_eager=True, callback=_print_version, help="Print the version."
    ),
    lenient: bool = typer.Option(False, "--lenient", callback=be_lenient, help=LENIENT_HELP),
) -> None:
    """3D skeletons of everybody in view, from depth images alone, on a CPU.

    [bold]Skeletons of a recording:[/bold]  depth-pose run in.mcap -o out.mcap

    [bold]Content of a recording:[/bold]  depth-pose info in.mcap

    [bold]Skeletons of many recordings:[/bold]  depth-pose run recordings/ -o skeletons/

    [bold]Draw them:[/bold]  depth-pose overlay in.mcap out.mcap -o picture.png

    [bold]Show them in a browser:[/bold]  depth-pose view in.mcap out.mcap

    [bold]Export them:[/bold]  depth-pose export out.mcap -o motion.bvh

    [bold]Measure gait and joint angles:[/bold]  depth-pose report out.mcap -o report.html

    [bold]Live, on a sensor's topics:[/bold]  depth-pose up

    [bold]Calibrate several cameras:[/bold]  depth-pose calibrate a.mcap b.mcap -o rig.yaml

    [bold]Without a sensor:[/bold]  depth-pose simulate -o bags/sim.mcap
    """


add_run(app)
add_info(app)
add_settings(app)
add_live(app)
add_fusion(app)
add_look(app)
add_simulation(app)
add_scoring(app)
add_rooms(app)
add_view(app)
add_export(app)
add_report(app)
app.add_typer(bank_app, name="bank")
app.add_typer(volume_app, name="volume")
unwrap_help(app)


def run_command() -> None:
    """Run the command; print expected errors on one line, exit code 1 (2 for a setting, 3 for damage)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a character that the terminal lacks must not end the command
            stream.reconfigure(errors="backslashreplace")
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(_Plain())
    try:
        with exit_on_damage():
            app(prog_name="depth-pose")
    except DepthPoseError as error:
        tell_error(error)
        sys.exit(2 if isinstance(error, ConfigError) else 1)
    except MemoryError as error:
        tell_error(f"there is too little memory{f': {error}' if str(error) else ''}")
        sys.exit(1)
    except SystemError as error:
        raise_if_interrupted(error)
        raise
    except BrokenPipeError:
        sys.exit(1)
    except OSError as error:  # a full disk, a folder that must not be read
        tell_error(f"{error.filename}: {error.strerror}" if error.filename else error)
        sys.exit(1)


class _Plain(logging.Formatter):
    """Log formatter that escapes unprintable characters."""

    def format(self, record: logging.LogRecord) -> str:
        return printable_lines(super().format(record))
