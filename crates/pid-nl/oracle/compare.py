"""Compares pid-nl with CasADi's own reader of .nl files, and the solver with Ipopt.

    pip install casadi
    cargo build --release -p pid-nl --example evaluate
    python compare.py target/release/examples/evaluate FILE.nl ...

For every file: values, gradient, Jacobian and Hessian at a point near the start, then both solvers from the start.
"""

import json
import re
import subprocess
import sys
import tempfile

import casadi as ca
import numpy as np


def off(a, b):
    """Largest difference relative to max(1, |b|); entries that both cannot evaluate agree."""
    a, b = np.asarray(a, float).ravel(), np.asarray(b, float).ravel()
    if a.size == 0:
        return 0.0
    both = ~np.isfinite(a) & ~np.isfinite(b)
    with np.errstate(invalid="ignore"):
        error = np.abs(a - b) / np.maximum(1.0, np.abs(b))
    error[both] = 0.0
    return float(np.nan_to_num(error.max(), nan=np.inf))


def dense(entries, shape):
    out = np.zeros(shape)
    for row, col, value in entries:
        out[row, col] += value
    return out


def compare(ours):
    nl = ca.NlpBuilder()
    # CasADi's reader takes no comments.
    with open(ours["file"]) as file, tempfile.NamedTemporaryFile("w", suffix=".nl") as bare:
        bare.writelines(line.split("#")[0].rstrip() + "\n" for line in file)
        bare.flush()
        nl.import_nl(bare.name)
    x, f, g = ca.vertcat(*nl.x), nl.f, ca.vertcat(*nl.g)
    n, m = x.numel(), g.numel()
    lam = ca.MX.sym("lam", m)
    lagrangian = f + (ca.dot(lam, g) if m else 0)
    derivatives = [ca.gradient(f, x), ca.jacobian(g, x), ca.hessian(lagrangian, x)[0]]
    values = ca.Function("v", [x, lam], [f, g, *derivatives])
    at, multipliers = ca.DM(ours["x"]), ca.DM(ours["lambda"])
    theirs = [np.array(ca.DM(v)) for v in values(at, multipliers)]
    lower = dense(ours["hessian"], (n, n))
    hessian = lower + np.tril(lower, -1).T
    errors = [
        off([ours["f"]], theirs[0]),
        off(ours["c"], theirs[1]),
        off(ours["gradient"], theirs[2]),
        off(dense(ours["jacobian"], (m, n)), theirs[3]) if m else 0.0,
        off(hessian, theirs[4]),
    ]
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    options = quiet | {"ipopt.max_iter": 3000, "ipopt.tol": 1e-8}
    solver = ca.nlpsol("s", "ipopt", {"x": x, "f": f, "g": g}, options)
    end = solver(x0=nl.x_init, lbx=nl.x_lb, ubx=nl.x_ub, lbg=nl.g_lb, ubg=nl.g_ub)
    stats = solver.stats()
    return errors, n, m, stats["success"], float(end["f"]), stats["iter_count"], stats["return_status"]


def main():
    program, files = sys.argv[1], sys.argv[2:]
    names = " ".join(f"{name:>8}" for name in ("f", "c", "gradient", "Jacobian", "Hessian"))
    print(f"{'file':<18}{'n':>5}{'m':>5}  {names}   ours, iterations; Ipopt's")
    for file in files:
        name = file.rsplit("/", 1)[-1]
        run = subprocess.run([program, file], capture_output=True, text=True, timeout=600)
        if not run.stdout:
            print(f"{name:<18} not read: {run.stderr.strip()}")
            continue
        # JSON has no infinity; Python reads it in this form.
        ours = json.loads(re.sub(r"(?<=[:,\[])(-?)inf", r"\1Infinity", run.stdout))
        try:
            errors, n, m, success, objective, iterations, status = compare(ours)
        except RuntimeError as error:
            end = ours["objective"], ours["iterations"], ours["status"]
            print(f"{name:<18} not read by CasADi: {str(error).splitlines()[-1][-60:]}; ours {end}")
            continue
        columns = " ".join(f"{e:8.1e}" for e in errors)
        ends = f"{ours['objective']:.9g} {ours['iterations']} {'' if ours['converged'] else ours['status']}"
        theirs = f"{objective:.9g} {iterations} {'' if success else status}"
        print(f"{name:<18}{n:>5}{m:>5}  {columns}   {ends}; {theirs}", flush=True)


main()
