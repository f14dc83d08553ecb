"""What a run of the tests depends on: versions of packages, kernels of linear algebra, and that the
programs under test hear signals."""

import signal
from collections import Counter
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("numpy", "scipy", "casadi", "cvxpy", "clarabel", "control")


def versions() -> str:
    return ", ".join(f"{name} {version(name)}" for name in PACKAGES)


def kernels() -> str:
    """For example "OpenBLAS of numpy Haswell, of scipy Haswell, 1 thread; loops of NumPy
    X86_V3"."""
    import scipy.linalg  # noqa: F401 - so that its library is loaded
    from numpy.lib.introspect import opt_func_info
    from threadpoolctl import threadpool_info

    pools = [each for each in threadpool_info() if each["internal_api"] == "openblas"]
    named = [
        f"of {Path(each['filepath']).parent.name.partition('.')[0]} {each['architecture']}"
        for each in pools
    ]
    threads = Counter(each["num_threads"] for each in pools).most_common(1)
    count = f"{threads[0][0]} thread{'s' * (threads[0][0] > 1)}" if threads else "no threads known"
    loops = opt_func_info(func_name="^add$")["add"]["ddd"]["current"]
    return f"OpenBLAS {', '.join(sorted(named)) or 'not found'}, {count}; loops of NumPy {loops}"


def let_children_hear() -> None:
    """A shell starts background jobs with Ctrl-C ignored, nohup does so with SIGHUP, and children
    inherit that.

    What a handler catches they do not inherit: programs under test hear signals again, and the
    tests ignore them still.
    """
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)
