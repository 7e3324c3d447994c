"""PEP 517 backend: maturin, with the program `phalanx` added as a script of the wheel.

Settings, as in ``pip install ./bindings/python --config-settings profile=dev``:

* ``profile``: cargo's profile for the program and the package (default: release);
* ``program``: path of an existing `phalanx`, which is packed instead of building one: relative to the directory
  where pip was started, or to the root of the clone.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import maturin
from maturin import (  # noqa: F401  (hooks of PEP 517)
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

PACKAGE = Path(__file__).resolve().parent.parent
ROOT = PACKAGE.parent.parent
# Files in this folder become scripts of the wheel; maturin needs the folder even if it only collects metadata.
SCRIPTS = PACKAGE / "phalanx.data" / "scripts"
SCRIPTS.mkdir(parents=True, exist_ok=True)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    _prepare(config_settings or {})
    return maturin.build_wheel(wheel_directory, None, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    _prepare(config_settings or {})
    return maturin.build_editable(wheel_directory, None, metadata_directory)


def build_sdist(sdist_directory, config_settings=None):
    raise RuntimeError(
        "a source distribution would lack the rest of the workspace: "
        "install from a clone with `pip install ./bindings/python`, or build a wheel with `pip wheel ./bindings/python`"
    )


def _prepare(settings):
    """Copies or builds the program, and passes the profile to maturin."""
    profile = settings.get("profile", "release")
    # One target folder for the program and the package, so that shared crates are built once.
    target = Path(os.environ.setdefault("CARGO_TARGET_DIR", str(ROOT / "target")))
    os.environ["MATURIN_PEP517_ARGS"] = f"--profile {profile}"
    program = settings.get("program")
    if program is None:
        _say(
            f"building the program `phalanx` first, unless {target} has it: minutes, the first time; "
            "`--config-settings program=target/release/phalanx` packs a program that is already built"
        )
        build = ["cargo", "build", "--locked", "--profile", profile, "--bin", "phalanx"]
        subprocess.run(build, cwd=ROOT, check=True)
        # The folder of the profile dev is named debug.
        program = target / {"dev": "debug"}.get(profile, profile) / "phalanx"
    else:
        program = _found(program)
    shutil.copy2(program, SCRIPTS / "phalanx")
    _say(f"packing {program}; now building the package itself, which takes minutes the first time")


def _found(program):
    """Returns the path of the program. pip runs this in the package's folder; the variable PWD has the directory of the shell."""
    places = [Path(folder, program) for folder in (os.environ.get("PWD", ROOT), ROOT)]
    for place in places:
        if place.is_file():
            return place
    looked = " or ".join(dict.fromkeys(map(str, places)))
    message = f"there is no file {looked}; `cargo build --release` makes it"
    raise SystemExit(f"phalanx: --config-settings program={program}: {message}")


def _say(words):
    """Prints a progress message, also to the terminal: pip shows standard error only with `-v`."""
    print(f"phalanx: {words}", file=sys.stderr, flush=True)
    try:
        with open("/dev/tty", "w") as terminal:
            print(f"\nphalanx: {words}", file=terminal)
    except OSError:
        pass  # there is no terminal
