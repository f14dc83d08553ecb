"""dobc: the command line.  Results go to standard output, everything else to standard error.

Exit codes: 0 proved or done, 1 refuted, 3 undecided, 2 the caller's mistake, 4 the machine failed,
130 interrupted.  With --json standard output holds one JSON document and nothing else.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from dobc_design.cli.completion import COMPLETING, completion, ids, problem_names
from dobc_design.cli.guard import abandon_output, guarded
from dobc_design.cli.output import (
    MACHINE,
    MISTAKE,
    Manner,
    NoOutput,
    Progress,
    check_target,
    complain,
    fail_with,
    manner_of,
    print_json,
    read_certificate,
    refuse_option,
    say,
    write_file,
)
from dobc_design.errors import CertificateError

app = typer.Typer(
    # typer's own options for it cost a tenth of the time of --help; those of ``options`` load them when they are used.
    add_completion=COMPLETING in os.environ,
    no_args_is_help=False,
    pretty_exceptions_enable=False,
    help="Certify disturbance-observer-based consensus control: from a problem file to a proof.",
)

Json = Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors; the exit code is the answer.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Every stage as a line on standard error.")]
File = Annotated[
    str, typer.Argument(help="A problem file, or the name of a built-in problem.", autocompletion=problem_names)
]


def _show_version(wanted: bool) -> None:
    if wanted:
        from dobc_design import __version__

        say(f"dobc {__version__}")
        raise typer.Exit(0)


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_show_version, help="Print the version.")
    ] = False,
    install_completion: Annotated[
        bool, typer.Option("--install-completion", callback=completion, help="Let your shell complete with tab.")
    ] = False,
    show_completion: Annotated[
        bool, typer.Option("--show-completion", callback=completion, help="Print what that adds to your shell.")
    ] = False,
) -> None:
    """Certify disturbance-observer-based consensus control: from a problem file to a proof."""


@app.command()
def problems(as_json: Json = False) -> None:
    """List the built-in problems."""
    from dobc_design.problem.load import builtin_names, builtin_summary

    rows = [{"name": name, "summary": builtin_summary(name)} for name in builtin_names()]
    if as_json:
        print_json({"problems": rows})
        return
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        say(f"{row['name']:<{width}}  {row['summary']}")


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the problem, of its files and of the folder.")],
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Make the problem from a MATPOWER case (.m), a pandapower network (.json), a MATLAB file (.mat) or"
            " arcs (.csv, .graphml, .edges; needs --arrow).",
        ),
    ] = None,
    arrow: Annotated[
        str | None, typer.Option(help="With --from: what an arc [a, b] means, listens_to or sends_to.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME.")] = None,
    as_json: Json = False,
) -> None:
    """Begin a project: a problem file to be changed, a notebook and a test, all of which work as they stand."""
    from dobc_design.cli.new import run_new

    raise typer.Exit(run_new(name, out=out, source=source, arrow=arrow, as_json=as_json))


@app.command()
def check(
    file: File,
    canonical: Annotated[Path | None, typer.Option(help="Write the canonical problem.json here.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite --canonical.")] = False,
    as_json: Json = False,
) -> None:
    """Validate a problem and say in words what it means."""
    from dobc_design.problem.canonical import canonical_bytes, problem_sha256
    from dobc_design.problem.load import load_problem
    from dobc_design.problem.words import describe, facts

    if canonical is not None:
        check_target(canonical, force=force, key="--canonical")
    problem = load_problem(file)
    if canonical is not None:
        write_file(canonical, canonical_bytes(problem), key="--canonical")
    if as_json:
        written = None if canonical is None else str(canonical)
        sha256 = problem_sha256(problem)
        print_json({"valid": True, **facts(problem), "problem_sha256": sha256, "canonical": written})
        return
    say(describe(problem))


@app.command()
def certify(
    file: File,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME-certificate.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Run every condition, also when one suffices.")] = False,
    theorem: Annotated[
        str | None, typer.Option(help="Show and judge only this condition, e.g. lemma1.", autocompletion=ids)
    ] = None,
    settling: Annotated[
        str | None, typer.Option(metavar="TOL", help="Also prove from when on every |e_i| stays below TOL.")
    ] = None,
    search: Annotated[bool, typer.Option("--search", help="Also look for starts that do not converge.")] = False,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and report.md.")] = True,
    apply_fix: Annotated[
        Path | None, typer.Option("--apply-fix", help="Write the cured problem here, a new .toml file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file of --apply-fix.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Decide every condition exactly; write certificate.json, problem.json and the report."""
    from dobc_design.cli.certify import run_certify

    raise typer.Exit(
        run_certify(
            file,
            out=out,
            everything=everything,
            theorem=theorem,
            report=report,
            apply_fix=apply_fix,
            force=force,
            manner=manner_of(quiet=quiet, verbose=verbose),
            as_json=as_json,
            settling=settling,
            search=search,
        )
    )


@app.command()
def verify(
    certificate: Annotated[Path, typer.Argument(help="certificate.json, or the folder it lies in.")],
    problem: Annotated[str, typer.Option(help="The trusted problem: TOML, problem.json or a built-in name.")],
    as_json: Json = False,
) -> None:
    """Check every claim of a certificate against the trusted problem, exactly."""
    from dobc_design.certification.certify import verify as run
    from dobc_design.problem.load import load_problem

    data = read_certificate(certificate)
    trusted = load_problem(problem)
    try:
        found = run(data, trusted)
    except CertificateError as error:
        # Unreadable: what was handed in is wrong, not the machine.
        raise typer.Exit(fail_with(error, MISTAKE, as_json=as_json)) from error
    if as_json:
        print_json(
            {
                "holds": found.holds,
                "verdict": found.verdict.value,
                "confirmed": list(found.confirmed),
                "failures": list(found.failures),
                "lone_checker": found.lone_checker,
            }
        )
    else:
        say(str(found))
    raise typer.Exit(0 if found.holds else 1)


@app.command()
def region(
    file: File,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME-certificate.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Try every method, also when one covers.")] = False,
    settling: Annotated[
        str | None, typer.Option(metavar="TOL", help="Also prove from when on every |e_i| stays below TOL.")
    ] = None,
    search: Annotated[bool, typer.Option("--search", help="Also look for starts that do not converge.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Say from which starts consensus is proved: numbers and a picture, without a report."""
    from dobc_design.cli.region import run_region

    code = run_region(
        file,
        out=out,
        everything=everything,
        settling=settling,
        search=search,
        manner=manner_of(quiet=quiet, verbose=verbose),
        as_json=as_json,
    )
    raise typer.Exit(code)


@app.command()
def design(
    file: File,
    out: Annotated[Path, typer.Option(help="Write the designed problem here, a new .toml file.")],
    rate: Annotated[str | None, typer.Option(help="The certified decay rate to be reached, in 1/s.")] = None,
    pins: Annotated[str | None, typer.Option(help="At most so many pinned agents; default as few as it takes.")] = None,
    max_gain: Annotated[str | None, typer.Option("--max-gain", help="The largest pinning gain, in 1/s.")] = None,
    noise: Annotated[
        str | None, typer.Option(help="Bound on the gain from measurement noise to the estimated disturbance, in 1/s.")
    ] = None,
    allowed: Annotated[
        list[str] | None, typer.Option(help="Labels of agents that may be pinned, with commas; may be repeated.")
    ] = None,
    digits: Annotated[int, typer.Option(help="Significant digits of W and of the gains.")] = 3,
    keep_exosystem: Annotated[
        bool, typer.Option("--keep-exosystem", help="Never put the observable part in the exosystem's place.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file of --out.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Design observer gain, pinned agents and gains, proved for the problem; or prove that it is impossible."""
    from dobc_design.cli.design import run_design

    code = run_design(
        file,
        out,
        rate=rate,
        pins=pins,
        max_gain=max_gain,
        noise=noise,
        allowed=allowed or [],
        digits=digits,
        keep_exosystem=keep_exosystem,
        force=force,
        manner=manner_of(quiet=quiet, verbose=verbose),
        as_json=as_json,
    )
    raise typer.Exit(code)


@app.command()
def simulate(
    file: File,
    runs: Annotated[int | None, typer.Option(help="How many runs, with the seeds S, S + 1, ...")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of starts and switches; default the problem's.")] = None,
    t_final: Annotated[float | None, typer.Option("--t-final", help="Horizon in s; default the problem's.")] = None,
    mode: Annotated[str | None, typer.Option(help="Stay in this mode, whatever [switching] says.")] = None,
    start: Annotated[str | None, typer.Option(help="Start from a CSV or .npz file.")] = None,
    observer: Annotated[
        str, typer.Option(help="closed-form, full-loop (the reference), or off: d is not compensated.")
    ] = "closed-form",
    noise: Annotated[float, typer.Option(help="Stress: standard deviation of measured states.")] = 0.0,
    disturbance: Annotated[float, typer.Option(help="Stress: amplitude of a sine that no exosystem knows.")] = 0.0,
    saturation: Annotated[float | None, typer.Option(help="Stress: bound on every component of u.")] = None,
    period: Annotated[float | None, typer.Option(help="Stress: sample and hold, every so many s.")] = None,
    loss: Annotated[float, typer.Option(help="Stress: probability that a packet is lost.")] = 0.0,
    fail: Annotated[
        list[str] | None, typer.Option(help="Stress: LABEL@TIME or LABEL@TIME:freeze; may be repeated.")
    ] = None,
    breaking: Annotated[
        bool, typer.Option("--what-breaks-first", help="Make every stress worse until the loop no longer converges.")
    ] = False,
    certificate: Annotated[Path | None, typer.Option(help="Show what this certificate proves beside the runs.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for arrays (.npz), figures and summary.json.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files in --out.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Simulate runs of the closed loop; a run that diverges is an answer and leaves with 0, too."""
    from dobc_design.cli.simulate import read_stress, refuse_beside_breaking, run_breaking, run_simulation

    if out is not None:
        refuse_option(out, key="--out")
    stress = read_stress(
        noise=noise, disturbance=disturbance, saturation=saturation, period=period, loss=loss, fail=fail or []
    )
    if breaking:
        refuse_beside_breaking(runs=runs, stress=stress, observer=observer)
    manner = manner_of(quiet=quiet, verbose=verbose)
    with Progress(manner) as progress:
        if breaking:
            answer = run_breaking(
                file,
                seed=seed,
                t_final=t_final,
                mode=mode,
                start=start,
                certificate=certificate,
                out=out,
                force=force,
                progress=progress,
            )
        else:
            answer = run_simulation(
                file,
                runs=runs,
                seed=seed,
                t_final=t_final,
                mode=mode,
                start=start,
                observer=observer,
                stress=stress,
                out=out,
                force=force,
                progress=progress,
                certificate=certificate,
            )
    if as_json:
        print_json(answer.document)
    elif manner is not Manner.QUIET:
        say(answer.text)


@app.command()
def report(
    certificates: Annotated[
        list[Path], typer.Argument(metavar="CERT [CERT]", help="certificate.json, or its folder; one or two.")
    ],
    problem: Annotated[
        list[str] | None, typer.Option(help="The problem, once for each; default problem.json beside it.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default that of CERT, or for two ./NAME-NAME-comparison.")
    ] = None,
    pdf: Annotated[Path | None, typer.Option("--pdf", help="Also as a PDF, to sign; needs dobc_design[pdf].")] = None,
    latex: Annotated[
        Path | None, typer.Option("--latex", metavar="DIR", help="Also as LaTeX fragments and BibTeX, into DIR.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files there.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Write the report of a certificate again, or two certificates side by side."""
    from dobc_design.cli.report import run_report

    raise typer.Exit(
        run_report(
            certificates,
            problems=problem or [],
            out=out,
            force=force,
            pdf=pdf,
            latex=latex,
            manner=manner_of(quiet=quiet, verbose=verbose),
            as_json=as_json,
        )
    )


@app.command(name="sweep")
def sweep_command(
    file: File,
    axes: Annotated[
        list[str],
        typer.Argument(
            metavar="KEY=VALUES...",
            help="What is varied: KEY=1:5:9 (nine values from 1 to 5), KEY=1:100:5:log, KEY=a,b,c, KEY=~uniform(0,1);"
            " KEY,KEY=VALUES sets both. Listed values make a grid.",
        ),
    ],
    task: Annotated[str, typer.Option(help="certify or simulate every case.")] = "certify",
    samples: Annotated[int | None, typer.Option(help="How many draws of the keys with ~, at every grid point.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the draws.")] = 0,
    runs: Annotated[int, typer.Option(help="With --task simulate: runs of every case.")] = 1,
    everything: Annotated[bool, typer.Option("--all", help="With --task certify: run every condition.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder of the sweep, new or begun; default ./NAME-sweep.")] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes; default one per processor.")] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, or local: a cluster on this machine.")
    ] = None,
    time_limit: Annotated[
        str | None, typer.Option("--time-limit", help="Seconds after which a case is given up and the rest goes on.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Begin anew, also in the folder of another sweep.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Certify or simulate a problem with some keys varied: in parallel, resumable, nothing done twice."""
    from dobc_design.cli.sweep import run_sweep

    raise typer.Exit(
        run_sweep(
            file,
            axes,
            task=task,
            samples=samples,
            seed=seed,
            runs=runs,
            everything=everything,
            out=out,
            jobs=jobs,
            cluster=cluster,
            force=force,
            manner=manner_of(quiet=quiet, verbose=verbose),
            as_json=as_json,
            time_limit=time_limit,
        )
    )


@app.command()
def export(
    file: Annotated[str, typer.Argument(help="For --rocq a certificate.json or its folder, else a problem.")],
    c: Annotated[Path | None, typer.Option("--c", help="Write C99 of the sampled agents into this folder.")] = None,
    fmu: Annotated[Path | None, typer.Option("--fmu", help="Write one agent as an FMU (FMI 3.0).")] = None,
    sdpa: Annotated[Path | None, typer.Option("--sdpa", help="Write the LMI for any SDP solver (.dat-s).")] = None,
    python_control: Annotated[
        Path | None, typer.Option("--python-control", help="Write the loop as a Python file for python-control.")
    ] = None,
    rocq: Annotated[Path | None, typer.Option(help="Write the proved theorem as a Rocq (Coq) file here.")] = None,
    period: Annotated[str | None, typer.Option(help="With --c, --fmu: seconds from sample to sample.")] = None,
    precision: Annotated[str | None, typer.Option(help="With --c: double (default) or float.")] = None,
    agent: Annotated[str | None, typer.Option(help="With --c, --fmu: only the agent of this label.")] = None,
    certificate: Annotated[
        Path | None, typer.Option(help="With --c: say whether its proved sampling period covers this one.")
    ] = None,
    problem: Annotated[str | None, typer.Option(help="With --rocq: default problem.json beside it.")] = None,
    rate: Annotated[bool, typer.Option("--rate", help="With --rocq: also state the certified rate.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Write C code, an FMU, the LMI for other solvers, a python-control file, or a proof for Rocq (Coq 8.16)."""
    from dobc_design.cli.export import Asked, run_export

    asked = Asked(
        c=c,
        fmu=fmu,
        sdpa=sdpa,
        python_control=python_control,
        rocq=rocq,
        period=period,
        precision=precision,
        agent=agent,
        certificate=certificate,
        problem=problem,
        rate=rate,
        force=force,
    )
    with Progress() as progress:
        done = run_export(file, asked, progress=progress)
    if as_json:
        print_json(done.document)
    else:
        say(done.text)


@app.command()
def explain(
    id: Annotated[
        str | None,
        typer.Argument(help="The id of a check, e.g. theorem1; without it all are listed.", autocompletion=ids),
    ] = None,
    as_json: Json = False,
) -> None:
    """Say what a condition means: the theorem in words."""
    from dobc_design.cli.explain import run_explain

    raise typer.Exit(run_explain(id, as_json=as_json))


@app.command()
def schema(as_json: Json = True) -> None:
    """Print the JSON Schema of the problem file."""
    from dobc_design.problem.schema import json_schema

    print_json(json_schema())


@app.command()
def doctor(as_json: Json = False) -> None:
    """Say what is installed, what is missing and how to install it, and whether the main path works."""
    from dobc_design.cli.doctor import run_doctor

    raise typer.Exit(run_doctor(as_json=as_json))


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and leave with its exit code.  No exception gets out of here."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    try:
        if sys.stdout is None:
            raise NoOutput("it is closed")
        code = guarded(lambda: app(args=given, prog_name="dobc", standalone_mode=False), as_json="--json" in given)
        sys.stdout.flush()
    except (NoOutput, OSError) as error:  # nobody reads standard output, or there is no room for it
        abandon_output()
        complain(
            f"error: standard output cannot be written: {getattr(error, 'strerror', None) or error}.\n"
            "       Send it to a file that has room, or to /dev/null; the exit code alone is no answer now."
        )
        code = MACHINE
    sys.exit(code)


if __name__ == "__main__":
    main()
