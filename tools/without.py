"""Shows that the project works without an extension.

    python -m tools.without NAME... [--imports]

A copy of the project without these extensions, and without what imports them outside of the kernel
(worlds, examples, benchmarks, tests), is installed in an environment of its own. There all modules
are imported, all commands and worlds are listed, and the quick tests run. With --imports, the copy
has no tests and documents, and no test runs. `all` stands for each extension after another.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import importlib.util
import os
import pkgutil
import shutil
import site
import subprocess
import sys
import tempfile
import traceback
import venv
import warnings
import zipfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import hatchling.build

ROOT = Path(__file__).parents[1]
INSTALLED = ("minerva_bus/", "services/", "agents/minerva_", "worlds/", "members/javascript/src/")
"""The folders of what is installed, without those of extensions."""


def import_all(names: Iterable[str]) -> None:
    """Import all modules of packages."""
    warnings.simplefilter("ignore")
    for name in names:
        package = importlib.import_module(name)
        for module in pkgutil.walk_packages(package.__path__, f"{name}."):
            if not module.name.endswith("__main__"):
                import_one(module.name)


def import_one(name: str) -> None:
    """Import a module; what lacks an extra that is not installed is left out."""
    try:
        importlib.import_module(name)
    except ImportError as error:
        if (error.name or "").startswith("minerva"):
            raise
    except Exception as error:
        # An extra that is not installed raises an error of the project with its remedy.
        if not type(error).__module__.startswith("minerva_bus"):
            raise


def packages_with(names: Iterable[str]) -> list[str]:
    """The packages of the project with these extensions."""
    own = ("bus", "services", "agents", "worlds", *names)
    return [f"minerva_{name}" for name in own]


def imports(project: Path, packages: list[str]) -> bool:
    """Whether all modules of a copy can be imported, in a fork that keeps imported libraries."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    code = 1
    try:
        for name in [name for name in sys.modules if name.startswith("minerva_")]:
            del sys.modules[name]
        sys.path[:] = [path for path in sys.path if not path.endswith("site-packages")]
        sys.path[:] = [path for path in sys.path if ROOT not in (Path(path), *Path(path).parents)]
        site.addsitedir(str(site_packages(project)))
        os.chdir(project)
        import_all(packages)
        elsewhere = [
            name
            for name, module in sys.modules.items()
            if name.startswith("minerva_") and str(project) not in str(module.__spec__)
        ]
        assert not elsewhere, elsewhere
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def extensions() -> list[str]:
    """The names of all extensions."""
    return sorted(path.name for path in (ROOT / "extensions").iterdir() if path.is_dir())


@cache  # Every extension asks for all files.
def imported(path: Path) -> frozenset[str]:
    """The top-level packages that a file imports; none if it does not name an extension."""
    text, names = path.read_text(encoding="utf-8"), set[str]()
    if not any(f"minerva_{name}" in text for name in extensions()):
        return frozenset()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module)
    return frozenset(name.partition(".")[0] for name in names)


def unit(path: Path) -> Path:
    """What is left out with a file that imports an extension: a world with its folder, or the file.

    Raises SystemExit for a file of the kernel.
    """
    match path.parts:
        case ("minerva_bus", *_):
            raise SystemExit(f"{path} of the kernel imports an extension")
        case ("worlds", "minerva_worlds", folder, _, *_):
            return Path("worlds/minerva_worlds", folder)
        case ("extensions" | "examples", folder, *_):
            return Path(path.parts[0], folder)
    return path


def is_installed(path: Path) -> bool:
    """Whether a file belongs to what is installed, or says what that is."""
    match path.parts:
        case ("extensions", _, package, *_):
            return package.startswith("minerva_")
        case (_,):
            return True
    return str(path).startswith(INSTALLED)


def copy(names: Iterable[str], to: Path, *, tests: bool) -> list[Path]:
    """Copy the project without extensions, and perhaps tests; returns what else is left out."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    folders = tuple(f"extensions/{name}/" for name in names)
    files = [Path(name) for name in listed if not name.startswith(folders)]
    files = [path for path in files if (ROOT / path).is_file() and (tests or is_installed(path))]
    needs = {path: imported(ROOT / path) for path in files if path.suffix == ".py"}
    absent, left_out = {f"minerva_{name}" for name in names}, list[Path]()
    # What imports an extension that is left out with another one is left out, too.
    while more := {unit(path) for path, needed in needs.items() if absent & needed} - {*left_out}:
        left_out = sorted({*left_out, *more})
        absent |= {f"minerva_{each.name}" for each in more if each.parts[0] == "extensions"}
    for path in files:
        if not any(path.is_relative_to(each) for each in left_out):
            (to / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / path, to / path)
            compiled = Path(importlib.util.cache_from_source(str(path)))
            if path.suffix == ".py" and (ROOT / compiled).is_file():
                (to / compiled).parent.mkdir(exist_ok=True)
                shutil.copy2(ROOT / compiled, to / compiled)
    settings = to / "pyproject.toml"
    gone = tuple(f'"{".".join(each.parts[1:])}:' for each in left_out)
    lines = settings.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if not any(entry in line for entry in gone)]
    settings.write_text("".join(kept), encoding="utf-8")
    return left_out


def site_packages(project: Path) -> Path:
    """The folder of installed packages of a copy."""
    return next(project.glob(".venv/lib/*/site-packages"))


def install(project: Path) -> Path:
    """Install a copy in a new environment with the libraries of this one; returns its Python."""
    folder = project / ".venv"
    venv.create(folder, symlinks=True)
    # Path files within these folders are not read, so this project is not among the libraries.
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (site_packages(project) / "libraries.pth").write_text("\n".join(libraries), encoding="utf-8")
    # An installation is an unpacked wheel; pip and uv would take another second to do that.
    with contextlib.chdir(project):
        wheel = folder / hatchling.build.build_editable(str(folder))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site_packages(project))
    return folder / "bin" / "python"


def run(names: list[str], *, tests: bool) -> int:
    """Check the project without these extensions; returns the exit code."""
    print(f"without {', '.join(names)}", flush=True)
    with tempfile.TemporaryDirectory(prefix="minerva-without-") as folder:
        project = Path(folder)
        left_out = copy(names, project, tests=tests)
        if left_out:
            print(f"  also left out: {', '.join(map(str, left_out))}", flush=True)
        environment = {key: os.environ[key] for key in os.environ if key != "PYTHONPATH"}
        python = install(project)

        def passes(*words: object) -> bool:
            done = subprocess.run([python, *words], cwd=project, env=environment, check=False)
            return done.returncode == 0

        kept = [name for name in extensions() if (project / "extensions" / name).is_dir()]
        checks = [("-m", "minerva_bus", "--help"), ("-m", "minerva_bus", "worlds")]
        if tests:
            checks.append(("-m", "pytest", "-q", "-m", "quick", "-p", "no:cacheprovider"))
        passed = imports(project, packages_with(kept)) and all(passes(*words) for words in checks)
        return 0 if passed else 1


def main(words: list[str] | None = None) -> int:
    """Run the program with these arguments; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="+", choices=[*extensions(), "all"], metavar="NAME")
    parser.add_argument("--imports", action="store_true", help="copy and run no tests")
    given = parser.parse_args(words)
    every = [given.names]
    if "all" in given.names:
        every = [[name] for name in extensions()]
        import_all(packages_with(extensions()))  # Each fork keeps the libraries.
    return max(run(names, tests=not given.imports) for names in every)


if __name__ == "__main__":
    sys.exit(main())
