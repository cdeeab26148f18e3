"""Two independent pictures by Cycles. Usage: render_cycles.py SCENE.json OUT.npz (a child of measure.py)

Colour: the diffuse reflectance of a half space of the medium, as light that entered leaves it. Cycles inverts it into a
single-scattering albedo for a boundary without internal reflection. Radius: 4 pi mean free paths, because Cycles divides
by 4 pi and takes what is left as the mean free path (random walk), or as the length d of the profile (Burley), which is
the mean free path over s(colour), equation 6 of Christensen and Burley 2015; Blender 5 leaves that division to the user.
"""

import json
import math
import os
import sys
import tempfile
import time

import bpy
import mathutils
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from pictures import read_exr, rgb  # noqa: E402

NEVER = 1024


def set_up(asked):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    cycles.blur_glossy = 0.0
    for kind in ("max", "diffuse", "glossy", "transmission"):
        setattr(cycles, f"{kind}_bounces", NEVER)
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = asked["width"], asked["height"], 100
    render.film_transparent = True
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode, render.image_settings.color_depth = "RGBA", "32"
    render.image_settings.exr_codec = "ZIP"

    world = bpy.data.worlds.new("world")
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes.get("Background") or world.node_tree.nodes.new("ShaderNodeBackground")
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = asked["radiance"]
    output = world.node_tree.nodes.get("World Output") or world.node_tree.nodes.new("ShaderNodeOutputWorld")
    world.node_tree.links.new(background.outputs["Background"], output.inputs["Surface"])

    mesh = bpy.data.meshes.new("body")
    mesh.from_pydata(np.load(asked["vertices"]).tolist(), [], np.load(asked["triangles"]).tolist())
    body = bpy.data.objects.new("body", mesh)
    scene.collection.objects.link(body)
    mesh.materials.append(material(asked))

    spec = asked["camera"]
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.angle_y = "VERTICAL", math.radians(spec["fov"])
    data.clip_start, data.clip_end = 1e-2, 1e5
    eye, target = mathutils.Vector(spec["at"]), mathutils.Vector(spec["look"])
    forward = (target - eye).normalized()
    right = forward.cross(mathutils.Vector(spec["up"])).normalized()
    camera = bpy.data.objects.new("camera", data)
    axes = mathutils.Matrix((right, right.cross(forward), -forward)).transposed()
    camera.matrix_world = mathutils.Matrix.Translation(eye) @ axes.to_4x4()
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def radius(asked):
    colours = asked["total_reflectance"]
    shape = [1.9 - a + 3.5 * (a - 0.8) ** 2 for a in colours] if asked["method"] == "BURLEY" else [1.0] * 3
    return [4 * math.pi * x / s for x, s in zip(asked["mean_free_path_mm"], shape)]


def material(asked):
    made = bpy.data.materials.new("medium")
    made.use_nodes = True
    nodes = made.node_tree.nodes
    shader = nodes.get("Principled BSDF") or nodes.new("ShaderNodeBsdfPrincipled")
    output = nodes.get("Material Output") or nodes.new("ShaderNodeOutputMaterial")
    made.node_tree.links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    shader.subsurface_method = asked["method"]
    for name, value in {
        "Base Color": (*asked["total_reflectance"], 1.0),
        "Subsurface Weight": 1.0,
        "Subsurface Radius": radius(asked),
        "Subsurface Scale": 1.0,
        "Subsurface Anisotropy": 0.0,
        "IOR": asked["eta"],
        "Roughness": 0.0,
    }.items():
        # Burley's method has no input for the phase function.
        if name in shader.inputs:
            shader.inputs[name].default_value = value
    return made


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        asked = json.load(file)
    scene = set_up(asked)

    def render(seed, spp):
        scene.cycles.seed, scene.cycles.samples = seed, spp
        start = time.process_time()
        with tempfile.TemporaryDirectory() as work:
            scene.render.filepath = os.path.join(work, "picture.exr")
            bpy.ops.render.render(write_still=True)
            cpu = time.process_time() - start
            layers = read_exr(scene.render.filepath)
        return rgb(layers), layers["A"], cpu

    render(0, 1)
    setup = time.process_time()
    (a, alpha, cpu_a), (b, _, cpu_b) = (render(seed, asked["spp"]) for seed in (1, 2))
    info = {"setup_cpu_s": setup, "render_cpu_s": [cpu_a, cpu_b], "version": f"Blender {bpy.app.version_string}"}
    np.savez(sys.argv[2], a=a, b=b, alpha=alpha, info=json.dumps(info))


main()
