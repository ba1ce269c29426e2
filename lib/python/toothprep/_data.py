"""Where the shipped data lies: burs, rubrics, presets."""
import os
from pathlib import Path

from . import _core


def data_folder():
    """The folder with burs, rubrics and presets: $TOOTHPREP_DATA, installed beside the package, or the sources'."""
    given = os.environ.get("TOOTHPREP_DATA")
    if given:
        return given
    for parent in Path(__file__).resolve().parents:
        if parent.name == "lib":
            installed = parent.parent / "share" / "toothprep"
            if (installed / "burs").is_dir():
                return str(installed)
    return _core.source_data_folder
