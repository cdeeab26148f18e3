"""Mitsuba 3, Cycles and translux on one object: CPU time, noise, time to equal error, pictures. Called by scripts/peers/run.

Lengths in mm; radiance is linear sRGB under an environment of radiance 1. See docs/peers.md for what the figures mean.
"""

import argparse
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile

import numpy as np

from pictures import display, read_exr, rgb, write_png

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
# Newest releases first; each interpreter is tried with the packages that PyPI has for it.
PYTHONS = ("python3.13", "python3.12", "python3.11", "python3.10", "python3")
PEERS = {
    "mitsuba": ("Mitsuba 3, volpathmis", "mitsuba", "render_mitsuba.py", None),
    "random-walk": ("Cycles, random walk", "bpy", "render_cycles.py", "RANDOM_WALK"),
    "burley": ("Cycles, Burley", "bpy", "render_cycles.py", "BURLEY"),
}
LIMIT_SECONDS = 3600


class Failure(Exception):
    """What went wrong, as a person should read it."""


def run(command, env=None):
    """Standard output and CPU seconds (user and system, its children included) of a command."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        try:
            child = subprocess.Popen(command, stdout=out, stderr=err, env=env)
        except OSError as error:
            raise Failure(f"{command[0]}: {error.strerror}") from error
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0), err.seek(0)
        text, errors = out.read().decode(errors="replace"), err.read().decode(errors="replace")
    if child.returncode != 0:
        tail = "\n".join((text + errors).strip().splitlines()[-6:])
        raise Failure(f"{' '.join(map(str, command[:3]))} ... failed ({child.returncode}):\n{tail}")
    return text, used.ru_utime + used.ru_stime


def python_with(package, venvs):
    """An environment that imports `package`, made where there is none; or why it cannot be had."""
    folder = os.path.join(venvs, package)
    python = os.path.join(folder, "bin", "python")
    imports = lambda: subprocess.run([python, "-c", f"import {package}, numpy"], capture_output=True).returncode == 0
    if os.path.exists(python) and imports():
        return python
    reasons = []
    for name in PYTHONS:
        base = shutil.which(name)
        if not base or subprocess.run([base, "--version"], capture_output=True).returncode != 0:
            continue
        shutil.rmtree(folder, ignore_errors=True)
        made = subprocess.run([base, "-m", "venv", folder], capture_output=True, text=True)
        pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package, "numpy"]
        done = made if made.returncode else subprocess.run(pip, capture_output=True, text=True)
        if done.returncode == 0 and imports():
            return python
        lines = (done.stderr or done.stdout or "its import fails").strip().splitlines()
        reasons.append(f"{name}: {lines[-1]}")
    shutil.rmtree(folder, ignore_errors=True)
    raise Failure("; ".join(reasons) or f"none of {', '.join(PYTHONS)} runs here")


def llvm_library():
    """The newest LLVM library of this machine, 19 preferred, for Mitsuba's fast variants."""
    folders = ["/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib"]
    folders += [f"/usr/lib/llvm-{v}/lib" for v in (19, 20, 18, 17)]
    for version in (19, 20, 18, 17):
        for folder in folders:
            for name in (f"libLLVM-{version}.so", f"libLLVM.so.{version}.1", f"libLLVM-{version}.so.1"):
                if os.path.exists(os.path.join(folder, name)):
                    return os.path.join(folder, name)
    return None


def read_obj(path):
    points, faces = [], []
    if not os.path.isfile(path):
        raise Failure(f"there is no {path}")
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                points.append([float(x) for x in words[1:4]])
            elif words[:1] == ["f"]:
                index = [int(w.split("/")[0]) for w in words[1:]]
                index = [i - 1 if i > 0 else len(points) + i for i in index]
                faces += [[index[0], index[k - 1], index[k]] for k in range(2, len(index))]
    if not faces:
        raise Failure(f"{path} has no triangles; the peers read OBJ only")
    return np.array(points), np.array(faces, dtype=np.int32)


def scaled(points, faces, size_mm):
    """About the origin, as translux does, so that the diagonal of what the triangles use is `size_mm`."""
    used = points[np.unique(faces)]
    return points * (size_mm / np.linalg.norm(used.max(0) - used.min(0)))


def write_ply(path, points, faces):
    table = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
    table["n"], table["i"] = 3, faces
    with open(path, "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
                   f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        file.write(points.astype("<f4").tobytes() + table.tobytes())


def read_ply_colours(path):
    """b_r, b_g, b_b of the vertices of a PLY that translux wrote."""
    kinds = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
    with open(path, "rb") as file:
        count, fields, inside = 0, [], False
        for line in iter(lambda: file.readline().decode("ascii", "replace").split(), ["end_header"]):
            if not line:
                raise Failure(f"{path} is no PLY")
            if line[0] == "element":
                inside = line[1] == "vertex"
                count = int(line[2]) if inside else count
            elif line[0] == "property" and inside:
                fields.append((line[2], kinds[line[1]]))
        table = np.frombuffer(file.read(count * np.dtype(fields).itemsize), dtype=fields)
    return np.stack([table[f"b_{c}"].astype(float) for c in "rgb"], axis=-1)


def vertex_areas(points, faces):
    corners = points[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.bincount(faces.ravel(), np.repeat(area / 3, 3), len(points))


def camera_of(text):
    """at=..:look=..:up=..:fov=.. as translux prints it."""
    parts = dict(part.split("=", 1) for part in text.split(":"))
    vector = lambda key: [float(x) for x in parts[key].split(",")]
    return {"at": vector("at"), "look": vector("look"), "up": vector("up"), "fov": float(parts["fov"])}


def translux_rows(asked, translux, work):
    """Our own pictures, and their CPU seconds: bake and render of each method."""
    rows = []
    body = [asked.model, "--size-mm", str(asked.size_mm), "--material", asked.material]
    light = ["--light", f"constant:radiance={asked.radiance}"]
    for method in asked.methods.split(","):
        asset = os.path.join(work, f"{method}.tlux")
        text, bake = run([translux, "bake", *body, "--method", method, "--for-lights", "constant", "--json", "-q", "-o", asset])
        baked = json.loads(text)
        exr, ply = os.path.join(asked.output, f"translux-{method}.exr"), os.path.join(work, f"{method}.ply")
        view = ["--camera", asked.camera] if asked.camera else []
        text, render = run([translux, "render", asset, *light, *view, "--roughness", "0", "--background", "none", "--exr-type",
                            "float", "--resolution", f"{asked.resolution}x{asked.resolution}", "--json", "-q", "-o", exr])
        run([translux, "evaluate", asset, *light, "-q", "-o", ply])
        layers, rendered = read_exr(exr), json.loads(text)
        rows.append({
            "name": f"translux, {method}", "key": f"translux-{method}", "version": f"translux {rendered['version']}",
            "bake_cpu_s": bake, "render_cpu_s": render, "camera": rendered["camera"], "medium": baked["media"][0],
            "picture": rgb(layers), "alpha": layers["coverage.A"], "b": read_ply_colours(ply),
        })
        print(f"{rows[-1]['name']}: bake {bake:.1f} CPU s, render {render:.1f} CPU s", file=sys.stderr, flush=True)
    return rows


def walk_difference(asked, translux, rows, points, faces, work):
    """Relative RMS of each of our methods against the random walk, by area; two walks take their noise out."""
    walks, cpu = [], []
    for seed in (1, 2):
        ply = os.path.join(work, f"walk{seed}.ply")
        cpu.append(run([translux, "reference", asked.model, "--size-mm", str(asked.size_mm), "--material", asked.material,
                        "--light", f"constant:radiance={asked.radiance}", "--model", "monte-carlo", "--photons",
                        str(asked.photons), "--seed", str(seed), "-q", "-o", ply])[1])
        walks.append(read_ply_colours(ply))
    area = vertex_areas(points, faces)[:, None]
    mean = lambda x: (area * x).sum() / (3 * area.sum())
    a, b = walks
    square = mean(a * b)
    for row in rows:
        row["against_walk_rms"] = float(np.sqrt(max(mean((row["b"] - a) * (row["b"] - b)), 0) / square))
        row["brightness_over_walk"] = float(mean(row["b"]) / mean(0.5 * (a + b)))
    return {"cpu_s": cpu, "photons": asked.photons, "noise_rms_of_a_walk": float(np.sqrt(mean((a - b) ** 2) / 2 / square))}


def peer_row(key, asked, scene, work, venvs):
    name, package, script, method = PEERS[key]
    try:
        python = python_with(package, venvs)
    except Failure as reason:
        return {"name": name, "key": key, "skipped": f"no {package}: {reason}"}
    path, out = os.path.join(work, f"{key}.json"), os.path.join(work, f"{key}.npz")
    spp = asked.spp or {"mitsuba": 4, "random-walk": 8, "burley": 8}[key]
    with open(path, "w", encoding="utf-8") as file:
        json.dump({**scene, "method": method, "spp": spp}, file)
    env = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    if package == "mitsuba" and "DRJIT_LIBLLVM_PATH" not in env and llvm_library():
        env["DRJIT_LIBLLVM_PATH"] = llvm_library()
    try:
        _, cpu = run([python, os.path.join(HERE, script), path, out], env)
    except Failure as reason:
        return {"name": name, "key": key, "failed": str(reason)}
    data = np.load(out)
    info = json.loads(str(data["info"]))
    print(f"{name}: {spp} samples a pixel twice, {cpu:.1f} CPU s", file=sys.stderr, flush=True)
    return {"name": name, "key": key, "spp": spp, "cpu_s": cpu, **info, "a": data["a"], "b": data["b"], "alpha": data["alpha"]}


def judge_peer(row, mask, target):
    a, b = row["a"][mask], row["b"][mask]
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        row["not_finite_pixels"] = int((~(np.isfinite(a) & np.isfinite(b))).any(-1).sum())
        a, b = np.nan_to_num(a), np.nan_to_num(b)
    noise = float(np.sqrt(np.mean((a - b) ** 2) / 2))
    # The mean square of the picture without its noise.
    level = float(np.sqrt(max(np.mean(a * b), 1e-30)))
    each = float(np.mean(row["render_cpu_s"]))
    row.update(noise_rmse=noise, noise_relative=noise / level, mean=float(np.mean([a, b])),
               extrapolated_cpu_s_to_target=row["setup_cpu_s"] + each * (noise / target) ** 2,
               extrapolated_spp_to_target=row["spp"] * (noise / target) ** 2)


def differences(row, peers, mask):
    """RMSE of a picture of ours against each peer, the peer's noise taken out by its two independent pictures."""
    ours = row["picture"][mask]
    row["against"] = {}
    for peer in peers:
        a, b = (np.nan_to_num(peer[k][mask]) for k in "ab")
        square = float(np.mean((ours - a) * (ours - b)))
        row["against"][peer["key"]] = {
            "rmse": float(np.sqrt(max(square, 0))),
            "relative": float(np.sqrt(max(square, 0) / max(np.mean(a * b), 1e-30))),
            "brightness": float(np.mean(ours) / np.mean(0.5 * (a + b))),
        }
    row["mean"] = float(np.mean(ours))


def sheet(path, ours, peers, size):
    """Upper row: pictures, left to right as the table. Lower row: what each has above (red) or below (blue) our first."""
    shown = [r["picture"] for r in ours] + [np.nan_to_num(0.5 * (p["a"] + p["b"])) for p in peers]
    first, covered = shown[0], ours[0]["alpha"] > 0.99
    white = max(np.percentile(picture[covered].max(-1), 90) for picture in shown)
    cell = 8
    rows = max(size // cell, 1) * cell
    upper, lower = [], []
    for picture in shown:
        upper.append(display(picture / white))
        gap = (picture - first)[:rows, :rows].mean(-1).reshape(rows // cell, cell, rows // cell, cell).mean((1, 3)) / white
        gap = np.clip(np.kron(gap, np.ones((cell, cell))) * 4, -1, 1)
        field = np.ones((*picture.shape[:2], 3))
        field[:rows, :rows, 0] = 1 + np.minimum(gap, 0)
        field[:rows, :rows, 1] = 1 - np.abs(gap)
        field[:rows, :rows, 2] = 1 - np.maximum(gap, 0)
        lower.append(field)
    write_png(path, np.concatenate([np.concatenate(upper, 1), np.concatenate(lower, 1)], 0))


def table(result):
    target = result["target_rmse"]
    lines = [f"| renderer | samples/pixel | CPU s, measured | noise, RMSE (relative) | CPU s to RMSE {target} | mean radiance | mask |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    for row in result["rows"]:
        if "skipped" in row or "failed" in row:
            why = row.get("skipped") or row["failed"]
            lines.append(f"| {row['name']} | {'SKIPPED' if 'skipped' in row else 'FAILED'}: {' '.join(why.split())} | | | | | |")
        elif "noise_rmse" in row:
            lines.append(
                f"| {row['name']} | {row['spp']}, twice | {row['cpu_s']:.1f} (of which {row['setup_cpu_s']:.1f} before) | "
                f"{row['noise_rmse']:.4f} ({100 * row['noise_relative']:.1f} %) | {row['extrapolated_cpu_s_to_target']:.3g} "
                f"(extrapolated by 1/N to {row['extrapolated_spp_to_target']:.0f} samples) | {row['mean']:.4f} | "
                f"{row['mask_pixels_apart']} px apart |")
        else:
            lines.append(
                f"| {row['name']} | | bake {row['bake_cpu_s']:.2f}, render {row['render_cpu_s']:.2f} | none: an error of the "
                f"model instead | {row['bake_cpu_s'] + row['render_cpu_s']:.3g} (measured) | {row['mean']:.4f} | |")
    lines += ["", "| ours | against | RMSE, noise taken out | relative | brightness, ours / theirs |", "| --- | --- | --- | --- | --- |"]
    for row in result["rows"]:
        for key, d in row.get("against", {}).items():
            name = PEERS[key][0]
            lines.append(f"| {row['name']} | {name} | {d['rmse']:.4f} | {100 * d['relative']:.1f} % | {d['brightness']:.4f} |")
        if "against_walk_rms" in row:
            lines.append(f"| {row['name']} | our random walk, exitance at the vertices | | {100 * row['against_walk_rms']:.1f} % | "
                         f"{row['brightness_over_walk']:.4f} |")
    return "\n".join(lines)


def arguments():
    p = argparse.ArgumentParser(prog="scripts/peers/run", description=__doc__.splitlines()[0])
    p.add_argument("model", help="OBJ, closed, one part")
    p.add_argument("--size-mm", type=float, required=True, help="diagonal of the bounding box")
    p.add_argument("--material", default="marble", help="a name of `translux materials`")
    p.add_argument("--radiance", type=float, default=1.0, help="of the environment, the same from everywhere")
    p.add_argument("--resolution", type=int, default=512, help="pixels of a side")
    p.add_argument("--camera", help="as `translux render` takes it (default: its own)")
    p.add_argument("--methods", default="two_pass,editable", help="methods of translux, separated by commas")
    p.add_argument("--peers", default=",".join(PEERS), help="which of " + ", ".join(PEERS))
    p.add_argument("--spp", type=int, help="samples a pixel of each of a peer's two pictures (default: 4 and 8)")
    p.add_argument("--target", type=float, default=0.01, help="RMSE of radiance that times are extrapolated to")
    p.add_argument("--photons", type=int, default=1_000_000, help="of each channel of our random walk, twice; 0 leaves it out")
    p.add_argument("--venvs", default=os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"),
                                                   "translux-peers"), help="folder of the Python environments")
    p.add_argument("--translux", help="the program (default: built here)")
    p.add_argument("-o", "--output", required=True, help="folder for peers.json, peers.md, peers.png and the pictures")
    asked = p.parse_args()
    unknown = set(asked.peers.split(",")) - PEERS.keys() - {""}
    if unknown:
        p.error(f"no peer is called {', '.join(sorted(unknown))}; there are {', '.join(PEERS)}")
    if asked.resolution < 8 or asked.target <= 0 or asked.photons < 0 or (asked.spp is not None and asked.spp < 1):
        p.error("--resolution from 8, --target above 0, --photons from 0, --spp from 1")
    return asked


def main():
    asked = arguments()
    asked.model = os.path.abspath(asked.model)
    os.makedirs(asked.output, exist_ok=True)
    translux = asked.translux or os.path.join(ROOT, "target", "release", "translux")
    if not asked.translux:
        run(["cargo", "build", "--release", "--quiet", "--locked", "--manifest-path", os.path.join(ROOT, "Cargo.toml")])
    presets = {m["name"]: m for m in json.loads(run([translux, "materials", "--json"])[0])["materials"]}
    if asked.material not in presets:
        raise Failure(f"no material is called {asked.material}; there are {', '.join(presets)}")
    preset = presets[asked.material]
    points, faces = read_obj(asked.model)
    points = scaled(points, faces, asked.size_mm)
    with tempfile.TemporaryDirectory() as work:
        ours = translux_rows(asked, translux, work)
        paths = {k: os.path.join(work, f) for k, f in (("ply", "body.ply"), ("vertices", "v.npy"), ("triangles", "f.npy"))}
        write_ply(paths["ply"], points, faces)
        np.save(paths["vertices"], points), np.save(paths["triangles"], faces)
        scene = {**paths, "camera": camera_of(ours[0]["camera"]), "width": asked.resolution, "height": asked.resolution,
                 "radiance": asked.radiance, "eta": preset["eta_inside_over_outside"],
                 **{k: preset[k] for k in ("sigma_s_reduced_per_mm", "sigma_a_per_mm", "g", "mean_free_path_mm",
                                           "total_reflectance")}}
        peers = [peer_row(key, asked, scene, work, asked.venvs) for key in asked.peers.split(",") if key]
        walk = walk_difference(asked, translux, ours, points, faces, work) if asked.photons else None
    good = [p for p in peers if "a" in p]
    # Pixels that every renderer sees wholly covered.
    mask = ours[0]["alpha"] > 0.999
    for peer in good:
        peer["mask_pixels_apart"] = int(((peer["alpha"] > 0.5) != (ours[0]["alpha"] > 0.5)).sum())
        mask &= peer["alpha"] > 0.999
    if not mask.any():
        raise Failure("no pixel is covered in every picture: the scenes differ, or the camera sees nothing")
    for peer in good:
        judge_peer(peer, mask, asked.target)
    for row in ours:
        differences(row, good, mask)
    sheet(os.path.join(asked.output, "peers.png"), ours, good, asked.resolution)
    keep = lambda row: {k: v for k, v in row.items() if not isinstance(v, np.ndarray)}
    result = {
        "schema": "translux.peers.v0", "model": os.path.basename(asked.model), "size_mm": asked.size_mm,
        "material": asked.material, "radiance": asked.radiance, "resolution": asked.resolution, "camera": ours[0]["camera"],
        "covered_pixels": int(mask.sum()), "target_rmse": asked.target, "load": os.getloadavg()[0], "random_walk": walk,
        "rows": [keep(r) for r in ours + peers],
    }
    text = table(result)
    with open(os.path.join(asked.output, "peers.json"), "w", encoding="utf-8") as file:
        json.dump(result, file, indent=2)
    with open(os.path.join(asked.output, "peers.md"), "w", encoding="utf-8") as file:
        file.write(text + "\n")
    print(text)
    for peer in peers:
        if "failed" in peer:
            raise Failure(f"{peer['name']}: {peer['failed']}")


if __name__ == "__main__":
    try:
        main()
    except Failure as failure:
        print(f"scripts/peers: {failure}", file=sys.stderr)
        sys.exit(1)
