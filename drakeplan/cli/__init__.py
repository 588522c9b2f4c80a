"""The command line: one file for each subcommand, imported when it is called.

Exit status: 0 done, 1 a plan that does not verify, 2 bad input, 3 no plan, 70 a defect of the program, 130 aborted.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module

from scenes.input_error import InputError, unknown_name

BAD_INPUT, DEFECT, ABORTED = 2, 70, 130

# name -> what it does; the module drakeplan.cli.<name> (_ for -) has Arguments, ABOUT and run(arguments) -> exit status
COMMANDS = {
    "plan": "plan a crossing: contacts, forces and a whole-body motion, verified",
    "verify": "check a plan file with code that shares nothing with the planner",
    "play": "show a plan in the browser, or write it as one HTML page",
    "simulate": "play a plan in physics, and say whether the robot arrives",
    "export": "write a plan in another tool's format: tables, MuJoCo, Crocoddyl, ROS 2, Foxglove and others",
    "robustness": "push a plan at every moment, and say how likely it is to arrive",
    "scenes": "list, show, import and export terrains",
    "robots": "list robots, add your own from its model, or check what one can do",
    "library": "build a library of plans that are adapted to new terrain, or look into one",
    "collect": "gather training data for surrogates, on this machine or a cluster",
    "train": "train surrogates on gathered data",
    "warm-up": "compile all kernels once, for example into an image",
    "bench": "measure speed and compare with peers",
}
OVERVIEW = """usage: drakeplan COMMAND ...

Plans how a humanoid crosses hard terrain with its feet and palms, and checks every plan.

commands:
{commands}

  drakeplan COMMAND --help says more about one of them.

examples:
  drakeplan plan rubble_corridor --out plan.h5 --html plan.html
  drakeplan verify plan.h5
  drakeplan play plan.h5
  drakeplan simulate plan.h5
  drakeplan scenes list
"""


def entry() -> int:
    """The program: `main`, and for commands with a deadline in a watched process."""
    tokens = sys.argv[1:]
    if tokens[:1] != ["plan"] or {"-h", "--help"} & set(tokens):
        return main(tokens)
    from drakeplan.cli.supervisor import supervise

    return supervise(lambda: main(tokens), as_json="--json" in tokens)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command and returns its exit status; `argv` without the program's name, by default the process's."""
    tokens = list(sys.argv[1:] if argv is None else argv)
    try:
        status = _dispatch(tokens)
        sys.stdout.flush()  # here, where a reader who has gone can still be caught
        return status
    except InputError as error:
        return _fail(str(error), BAD_INPUT, "bad input", tokens)
    except KeyboardInterrupt:
        return _fail("aborted", ABORTED, "aborted", tokens)
    except BrokenPipeError:  # whoever read our output has gone; say nothing more, not even when Python shuts down
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as stop:  # tyro, after --help
        return int(stop.code or 0)
    except Exception:
        traceback.print_exc()
        return _fail("this is a defect of drakeplan, not of your input", DEFECT, "defect", tokens)


def _dispatch(tokens: list[str]) -> int:
    if not tokens or tokens[0] in ("-h", "--help", "help"):
        width = max(map(len, COMMANDS))
        lines = "\n".join(f"  {name:<{width}}  {what}" for name, what in COMMANDS.items())
        print(OVERVIEW.format(commands=lines), end="")
        return 0 if tokens else BAD_INPUT
    if tokens[0] == "--version":
        from importlib.metadata import version

        print(f"drakeplan {version('drakeplan')}")
        return 0
    if tokens[0] not in COMMANDS:
        raise unknown_name("command", tokens[0], COMMANDS)
    from drakeplan.cli.arguments import parse

    command = import_module(f"drakeplan.cli.{tokens[0].replace('-', '_')}")
    return command.run(parse(command.Arguments, f"drakeplan {tokens[0]}", tokens[1:], about=command.ABOUT))


def _fail(message: str, status: int, kind: str, tokens: list[str]) -> int:
    """One line on standard error; with --json also an object on standard output."""
    print(message if message.startswith("drakeplan") else f"drakeplan: {message}", file=sys.stderr)
    if "--json" in tokens:
        print(json.dumps({"status": kind, "reason": message}))
    return status
