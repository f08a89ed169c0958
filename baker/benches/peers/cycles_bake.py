"""Bakes hours of a scene with Blender Cycles, one bake per hour: `cycles_bake.py JOB.json`. Run as a process of its own.

The job: glb (scene.glb of a baked dataset), lights (folder of `sky_image`), hours, size [width, height], samples, seed,
bounces, sky_map, threads, out (.npz). The result holds per hour the irradiance [height, width, 3], rows from the top, in the
unit of the lights, and the CPU seconds of every bake.
"""

import json
import math
import pathlib
import sys
import tempfile
import time

import bpy
import mathutils
import numpy

import glb

# Y up to Blender's Z up.
Z_UP = numpy.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
MASTER = "lightmap"


# Bounces that stand for no limit: what light is left then is below 1e-9 at the albedos of these scenes.
NO_LIMIT = 64


def main():
    job = json.loads(pathlib.Path(sys.argv[1]).read_text())
    scene = glb.read(pathlib.Path(job["glb"]))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    target = bpy.data.images.new("target", *job["size"], alpha=False, float_buffer=True)
    target.colorspace_settings.name = "Non-Color"
    materials = make_materials(scene, target)
    receiver = add_mesh("receiver", scene.lightmapped, materials, smooth=True)
    if len(scene.others.triangles):
        add_mesh("others", scene.others, materials, smooth=False)
    configure(job)
    receiver.select_set(True)
    bpy.context.view_layer.objects.active = receiver

    lights = pathlib.Path(job["lights"])
    described = json.loads((lights / "lights.json").read_text())
    entries = {entry["hour"]: entry for entry in described["hours"]}
    set_sun, set_sky = add_sun(), add_sky(described["height"], job["sky_map"])
    maps, seconds = {}, []
    for hour in job["hours"]:
        start = time.process_time()
        set_sun(entries[hour]["sun"])
        set_sky(lights / entries[hour]["sky"])
        bpy.ops.object.bake(
            type="DIFFUSE",
            pass_filter={"DIRECT", "INDIRECT"},
            margin=0,
            use_clear=True,
            target="IMAGE_TEXTURES",
            uv_layer=MASTER,
        )
        width, height = job["size"]
        pixels = numpy.empty(width * height * 4, numpy.float32)
        target.pixels.foreach_get(pixels)
        # What a white diffuse surface shows is E / pi; Blender's rows run upwards.
        maps[f"hour-{hour:07.4f}"] = math.pi * pixels.reshape(height, width, 4)[::-1, :, :3]
        seconds.append(time.process_time() - start)
    numpy.savez(job["out"], seconds=numpy.array(seconds), **maps)


def configure(job):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.threads_mode = "FIXED"
    scene.render.threads = job["threads"]
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = job["samples"]
    cycles.seed = job["seed"]
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.sample_clamp_direct = 0.0
    cycles.sample_clamp_indirect = 0.0
    cycles.max_bounces = NO_LIMIT if job["bounces"] is None else job["bounces"]
    cycles.diffuse_bounces = NO_LIMIT if job["bounces"] is None else job["bounces"]
    cycles.transparent_max_bounces = 256
    cycles.use_fast_gi = False
    cycles.use_guiding = False
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1.0


def make_materials(scene, target):
    """Diffuse reflectors: colour or texture, cut-outs, and black backs where the glTF says one-sided."""
    textures = [load_texture(data) for data in scene.images]
    result = []
    for description in scene.materials:
        pbr = description.get("pbrMetallicRoughness", {})
        factor = pbr.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        material = bpy.data.materials.new("m")
        material.use_nodes = True
        nodes, links = material.node_tree.nodes, material.node_tree.links
        nodes.clear()
        output = nodes.new("ShaderNodeOutputMaterial")
        diffuse = nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Roughness"].default_value = 0.0
        diffuse.inputs["Color"].default_value = (*factor[:3], 1.0)
        colour, alpha = None, None
        if "baseColorTexture" in pbr:
            index = pbr["baseColorTexture"]["index"]
            uv = nodes.new("ShaderNodeUVMap")
            uv.uv_map = "texture"
            image = nodes.new("ShaderNodeTexImage")
            image.image = textures[index]
            image.interpolation = "Linear"
            wrap = {10497: "REPEAT", 33071: "EXTEND", 33648: "MIRROR"}
            image.extension = wrap[scene.samplers[index].get("wrapS", 10497)]
            links.new(uv.outputs["UV"], image.inputs["Vector"])
            colour, alpha = image.outputs["Color"], image.outputs["Alpha"]
            if tuple(factor[:3]) != (1.0, 1.0, 1.0):
                colour = times(nodes, links, colour, factor[:3])
        if not description.get("doubleSided", False):
            # A back absorbs.
            geometry = nodes.new("ShaderNodeNewGeometry")
            front = nodes.new("ShaderNodeMath")
            front.operation = "SUBTRACT"
            front.inputs[0].default_value = 1.0
            links.new(geometry.outputs["Backfacing"], front.inputs[1])
            colour = times(nodes, links, colour if colour is not None else factor[:3], front.outputs[0])
        if colour is not None:
            links.new(colour, diffuse.inputs["Color"])
        shader = diffuse.outputs[0]
        if alpha is not None and description.get("alphaMode") == "MASK":
            keep = nodes.new("ShaderNodeMath")
            keep.operation = "GREATER_THAN"
            keep.inputs[1].default_value = description.get("alphaCutoff", 0.5) / max(factor[3], 1e-6)
            links.new(alpha, keep.inputs[0])
            mix = nodes.new("ShaderNodeMixShader")
            links.new(keep.outputs[0], mix.inputs[0])
            links.new(nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
            links.new(shader, mix.inputs[2])
            shader = mix.outputs[0]
        links.new(shader, output.inputs["Surface"])
        # Where the bake goes.
        into = nodes.new("ShaderNodeTexImage")
        into.image = target
        nodes.active = into
        result.append(material)
    return result


def times(nodes, links, a, b):
    """The product of two colours, each a socket or a constant."""
    node = nodes.new("ShaderNodeVectorMath")
    node.operation = "MULTIPLY"
    for socket, value in zip(node.inputs, (a, b)):
        if isinstance(value, bpy.types.NodeSocket):
            links.new(value, socket)
        else:
            socket.default_value = tuple(value)
    return node.outputs[0]


def load_texture(png):
    """A linear float copy of an sRGB image, so that it is interpolated in linear space, as our baker does."""
    with tempfile.NamedTemporaryFile(suffix=".png") as file:
        file.write(png)
        file.flush()
        stored = bpy.data.images.load(file.name)
        stored.colorspace_settings.name = "Non-Color"
        stored.alpha_mode = "CHANNEL_PACKED"
        pixels = numpy.empty(len(stored.pixels), numpy.float32)
        stored.pixels.foreach_get(pixels)
    pixels = pixels.reshape(-1, 4)
    c = pixels[:, :3]
    pixels[:, :3] = numpy.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    image = bpy.data.images.new("texture", *stored.size, alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    bpy.data.images.remove(stored)
    return image


def add_mesh(name, soup, materials, smooth):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata((soup.positions @ Z_UP.T).tolist(), [], soup.triangles.tolist())
    corners = soup.triangles.ravel()
    for layer, uvs in (("texture", soup.uvs), (MASTER, soup.lightmap_uvs)):
        uvs = uvs[corners].astype(numpy.float32)
        uvs[:, 1] = 1.0 - uvs[:, 1]
        mesh.uv_layers.new(name=layer).data.foreach_set("uv", uvs.ravel())
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", soup.materials.astype(numpy.int32))
    a, b, c = (soup.positions[soup.triangles[:, k]] for k in range(3))
    face = numpy.cross(b - a, c - a)
    face /= numpy.maximum(numpy.linalg.norm(face, axis=1, keepdims=True), 1e-30)
    bent = numpy.abs(numpy.einsum("tkj,tj->tk", soup.normals[soup.triangles], face) - 1).max() > 1e-4
    if smooth and bent:
        mesh.normals_split_custom_set((soup.normals @ Z_UP.T)[corners].tolist())
    else:
        mesh.polygons.foreach_set("use_smooth", numpy.zeros(len(mesh.polygons), bool))
    mesh.update()
    if mesh.validate():
        print(f"{name}: Blender dropped invalid faces", file=sys.stderr)
    item = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(item)
    return item


def add_sun():
    light = bpy.data.lights.new("sun", "SUN")
    item = bpy.data.objects.new("sun", light)
    bpy.context.collection.objects.link(item)

    def set_sun(disc):
        item.hide_render = disc is None
        if disc is None:
            return
        direction = mathutils.Vector(Z_UP @ numpy.array(disc["direction"]))
        item.rotation_mode = "QUATERNION"
        item.rotation_quaternion = direction.to_track_quat("Z", "Y")
        most = max(disc["irradiance"])
        light.energy = most
        light.color = [value / most for value in disc["irradiance"]]
        light.angle = math.radians(disc["angle"])

    return set_sun


def add_sky(rows, sky_map):
    image = bpy.data.images.new("sky", 2 * rows, rows, alpha=False, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    # Cycles' own choice of a map for importance sampling, 2048 x 1024, costs more than a second of CPU per bake.
    if sky_map == "none":
        world.cycles.sampling_method = "NONE"
    elif sky_map != "auto":
        world.cycles.sampling_method = "MANUAL"
        world.cycles.sample_map_resolution = int(sky_map)
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    # No mixing across the horizon, which is a border between rows.
    texture.interpolation = "Closest"
    background = nodes.new("ShaderNodeBackground")
    links.new(texture.outputs["Color"], background.inputs["Color"])
    links.new(background.outputs[0], nodes.new("ShaderNodeOutputWorld").inputs["Surface"])

    def set_sky(path):
        pixels = numpy.ones((rows, 2 * rows, 4), numpy.float32)
        pixels[:, :, :3] = numpy.fromfile(path, "<f4").reshape(rows, 2 * rows, 3)[::-1]
        image.pixels.foreach_set(pixels.ravel())
        image.update()

    return set_sky


main()
