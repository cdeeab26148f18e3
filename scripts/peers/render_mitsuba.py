"""Two independent pictures by Mitsuba 3. Usage: render_mitsuba.py SCENE.json OUT.npz (a child of measure.py)"""

import json
import sys
import time

import mitsuba as mi
import numpy as np

# No path is ended early: beyond any length that a walk reaches.
NEVER = 1_000_000
# LLVM's kernels first; the scalar variant needs no LLVM.
VARIANTS = ("llvm_ad_rgb", "scalar_rgb")


def choose_variant():
    for variant in VARIANTS:
        try:
            mi.set_variant(variant)
            # Fails here where the LLVM library is missing.
            mi.load_dict({"type": "sphere"}).bbox()
            if variant.startswith("llvm"):
                import drjit

                drjit.eval(drjit.arange(mi.Float, 4) + 1)
            return variant
        except Exception as error:  # Every failure of a variant means: try the next.
            print(f"{variant}: {error}", file=sys.stderr)
    sys.exit("no variant of Mitsuba runs here")


def scene_of(asked):
    rgb = lambda v: {"type": "rgb", "value": [float(x) for x in v]}
    # "rgb" of a medium must not exceed 1; `scale` carries the rest.
    sigma_s = np.array(asked["sigma_s_reduced_per_mm"]) / (1 - asked["g"])
    sigma_t = sigma_s + np.array(asked["sigma_a_per_mm"])
    camera, width, height = asked["camera"], asked["width"], asked["height"]
    phase = {"type": "hg", "g": asked["g"]} if asked["g"] else {"type": "isotropic"}
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "volpathmis", "max_depth": -1, "rr_depth": NEVER, "hide_emitters": True},
        "sensor": {
            "type": "perspective",
            "fov_axis": "y",
            "fov": camera["fov"],
            "near_clip": 1e-2,
            "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f().look_at(origin=camera["at"], target=camera["look"], up=camera["up"]),
            "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"},
                     "pixel_format": "rgba", "component_format": "float32"},
            "sampler": {"type": "independent"},
        },
        "light": {"type": "constant", "radiance": rgb([asked["radiance"]] * 3)},
        "body": {
            "type": "ply",
            "filename": asked["ply"],
            "face_normals": True,
            "bsdf": {"type": "dielectric", "int_ior": asked["eta"], "ext_ior": 1.0},
            "interior": {"type": "homogeneous", "albedo": rgb(sigma_s / sigma_t), "scale": float(sigma_t.max()),
                         "sigma_t": rgb(sigma_t / sigma_t.max()), "phase": phase},
        },
    })


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        asked = json.load(file)
    variant = choose_variant()
    scene = scene_of(asked)

    def render(seed, spp):
        start = time.process_time()
        picture = np.array(mi.render(scene, spp=spp, seed=seed), dtype=np.float64)
        return picture, time.process_time() - start

    # Compiles the kernels.
    render(0, 1)
    setup = time.process_time()
    (a, cpu_a), (b, cpu_b) = (render(seed, asked["spp"]) for seed in (1, 2))
    alpha = 0.5 * (a[..., 3] + b[..., 3])
    info = {"setup_cpu_s": setup, "render_cpu_s": [cpu_a, cpu_b], "version": f"Mitsuba {mi.__version__}, {variant}"}
    np.savez(sys.argv[2], a=a[..., :3], b=b[..., :3], alpha=alpha, info=json.dumps(info))


main()
