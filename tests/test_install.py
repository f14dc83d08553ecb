"""The wheel and the sdist, built from what the package consists of and tried where nothing of the
checkout is seen."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BUILD = (
    "import sys; from setuptools import build_meta; print(getattr(build_meta, "
    "sys.argv[1])(sys.argv[2]))"
)
SOURCE = ("pyproject.toml", "README.md", "LICENSE")
MOST = 1_480_000  # bytes of either; sources with named steps and comments are 1.4 million

pytestmark = pytest.mark.slow


def run(*command: object, cwd: Path) -> str:
    texts = [str(part) for part in command]
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        texts, check=False, cwd=cwd, env=clean, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The wheel and the sdist."""
    pytest.importorskip(
        "ensurepip", reason="needs Python's ensurepip, to make an environment that builds"
    )
    folder = tmp_path_factory.mktemp("build")
    for name in SOURCE:
        shutil.copy(ROOT / name, folder)
    shutil.copytree(
        ROOT / "dobc_design", folder / "dobc_design", ignore=shutil.ignore_patterns("__pycache__")
    )
    run(sys.executable, "-m", "venv", "builder", cwd=folder)
    python = folder / "builder" / "bin" / "python"
    wanted = [
        python,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "setuptools>=77",
    ]
    if subprocess.run(
        list(map(str, wanted)), check=False, cwd=folder, capture_output=True, timeout=300
    ).returncode:
        pytest.skip("needs a package index for setuptools, and none answers")
    (folder / "dist").mkdir()
    made = [
        run(python, "-c", BUILD, what, folder / "dist", cwd=folder)
        for what in ("build_wheel", "build_sdist")
    ]
    return [folder / "dist" / said.split()[-1] for said in made]


def test_wheel_and_sdist_are_small_and_hold_the_same_files(built: list[Path]):
    wheel, sdist = built
    sys.stdout.write(
        f"wheel {wheel.stat().st_size // 1000} kB, sdist {sdist.stat().st_size // 1000} kB\n"
    )
    assert max(each.stat().st_size for each in built) < MOST
    with tarfile.open(sdist) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    own = {
        str(path.relative_to(ROOT)) for path in (ROOT / "dobc_design").rglob("*") if path.is_file()
    }
    assert {name for name in own if "__pycache__" not in name} <= packed


def test_the_wheel_gives_a_working_dobc_without_the_checkout(built: list[Path], tmp_path: Path):
    """The packages it needs are those of this environment; dobc_design itself comes from the wheel
    alone."""
    run(sys.executable, "-m", "venv", "clean", cwd=tmp_path)
    clean = tmp_path / "clean"
    python = clean / "bin" / "python"
    run(
        python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", built[0], cwd=tmp_path
    )
    (own,) = clean.glob("lib/python*/site-packages")
    (own / "others.pth").write_text(sysconfig.get_paths()["purelib"] + "\n", encoding="utf-8")
    where = run(
        python, "-P", "-c", "import dobc_design; print(dobc_design.__file__)", cwd=tmp_path
    ).strip()
    assert Path(where).is_relative_to(own)
    dobc = clean / "bin" / "dobc"
    assert "PROVED" in run(dobc, "certify", "paper-fixed", "--out", "c", cwd=tmp_path)
    assert (tmp_path / "c" / "report.html").stat().st_size > 50_000
    assert "paper-fixed" in run(dobc, "problems", cwd=tmp_path)
    run(dobc, "verify", "c", "--problem", "paper-fixed", cwd=tmp_path)
    run(dobc, "new", "mine", cwd=tmp_path)
    run(dobc, "export", "c/problem.json", "--c", "code", "--period", "0.0005", cwd=tmp_path)
    checker = own / "dobc_design" / "checker"
    run(python, "-I", "-S", checker, "c/certificate.json", "c/problem.json", cwd=tmp_path)
