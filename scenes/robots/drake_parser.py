"""Drake's parser with its errors as bad input: one line that says what to do."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.framework import Context

from scenes.input_error import InputError

REMEDIES = (  # what Drake says -> what helps
    ("unknown package", "add --package NAME=DIR with the package's folder"),
    ("package://", "add --package NAME=DIR with the package's folder"),
    (
        "unsupported extension",
        "convert the mesh to .obj, or describe the model in a robot file, whose meshes are converted",
    ),
    (
        "only supports mesh files",
        "convert the mesh to .obj, or describe the model in a robot file, whose meshes are converted",
    ),
    ("xacro", "expand the file first: xacro MODEL.urdf.xacro > MODEL.urdf"),
)


DRAKES_ERRORS = (RuntimeError, ValueError, TypeError, IndexError, SystemExit)  # the last stands for a failed condition
MOST_WORDS = 300  # letters of a warning
_said: set[str] = set()


@contextlib.contextmanager
def reading(model: Path) -> Iterator[None]:
    """Inside, what Drake finds wrong is the model's fault; what it warns of is said once, in a line, if the model loads.

    Args:
        model: the file, for errors.

    Raises:
        InputError: Drake cannot make a plant of the model.
    """
    log, heard = logging.getLogger("drake"), []

    def keep(record: logging.LogRecord) -> bool:
        heard.append(" ".join(record.getMessage().split())[:MOST_WORDS])
        return False

    log.addFilter(keep)
    try:
        yield
    except DRAKES_ERRORS as error:
        raise error if isinstance(error, InputError) else unreadable_model(model, error) from None
    finally:
        log.removeFilter(keep)
    for words in heard:
        if words not in _said:
            _said.add(words)
            log.warning(words)


def add_model(plant: MultibodyPlant, model: Path) -> None:
    """Adds the models of a file to a plant.

    Args:
        plant: not yet finalized.
        model: URDF, SDF or MJCF.

    Raises:
        InputError: Drake cannot read the file.
    """
    with reading(model):
        Parser(plant).AddModels(model)


def unreadable_model(model: Path, error: BaseException) -> InputError:
    """The error of Drake's parser in one line, with the remedy where one is known.

    Args:
        model: the file.
        error: what Drake raised.
    """
    text = " ".join(str(error).split()).removeprefix(f"{model}:")
    text = text.partition(" See https://drake.mit.edu")[0].rstrip(". ")
    remedy = next((what for sign, what in REMEDIES if sign in text), "")
    return InputError(f"{model}: Drake cannot read this model ({text}){': ' + remedy if remedy else ''}")


def set_joint(joint: Joint, context: Context, position: float) -> None:
    """Sets the position of a joint with one degree of freedom.

    Args:
        joint: revolute or prismatic.
        context: of its plant.
        position: [rad] or [m].
    """
    if isinstance(joint, PrismaticJoint):
        joint.set_translation(context, position)
    else:
        joint.set_angle(context, position)
