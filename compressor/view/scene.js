// The scene: geometry, materials and cameras of a GLB file with lightmap coordinates, and how they are drawn.
'use strict';

const SIZES = { 5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4 };
const PARTS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };
const ATTRIBUTES = ['POSITION', 'NORMAL', 'TEXCOORD_0', 'TEXCOORD_1', 'COLOR_0'];
const VIEWS = ['decoded', 'reference', 'difference', 'bits'];

const DRAW_VERTEX = `#version 300 es
in vec3 position, normal; in vec2 texcoord, lightmap; in vec4 tint;
uniform mat4 clip; uniform mat3 turn; uniform vec4 place;
out vec2 uv, lm; out vec3 n, p; out vec4 colour;
void main() { p = turn * position; uv = texcoord; lm = place.xy * lightmap + place.zw; n = turn * normal; colour = tint; gl_Position = clip * vec4(position, 1); }`;

// The tone curve is that of bake preview: linear to 0.7, then towards 1, then sRGB.
const TONE = `
vec3 tone(vec3 x) {
  x = mix(1. - .3 * exp(-(x - .7) / .3), max(x, 0.), lessThanEqual(x, vec3(.7)));
  return mix(1.055 * pow(x, vec3(1. / 2.4)) - .055, 12.92 * x, lessThanEqual(x, vec3(.0031308)));
}
vec3 irradiance(vec2 at) {
  vec3 e = texture(map, at).rgb / scale;
  if (view == 0) return e;
  vec3 r = texture(reference, at).rgb / referenceScale;
  return view == 1 ? r : 8. * abs(e - r);
}`;

const DRAW_FRAGMENT = `#version 300 es
precision highp float; precision highp int;
in vec2 uv, lm; in vec3 n, p; in vec4 colour;
uniform sampler2D map, reference, bits, albedo; uniform vec4 base, uvPlace; uniform vec3 ambient;
uniform float scale, referenceScale, exposure, cutoff; uniform int view, mode; uniform bool mapped, game; uniform ivec2 pageSize; uniform float page;
out vec4 color;
${TONE}
void main() {
  vec4 a = base * colour * texture(albedo, uvPlace.xy * uv + uvPlace.zw);
  if (a.a < cutoff) discard;
  // Engines sample a lightmap whatever side they draw.
  bool lit = mapped && (gl_FrontFacing || game);
  if (mode == 2) { color = lit ? vec4(page + 1., lm, 1) : vec4(0, 0, 0, 1); return; }
  // Flat meshes have no normals.
  vec3 facing = normalize(dot(n, n) > 0. ? (gl_FrontFacing ? n : -n) : cross(dFdx(p), dFdy(p)));
  vec3 e = lit ? irradiance(lm) : ambient * (.75 + .25 * facing.y);
  if (!lit && (game || view == 2)) e = vec3(0);
  if (view == 3) {
    vec3 shade = lit ? texelFetch(bits, ivec2(clamp(lm, 0., .99999) * vec2(pageSize)) / ${PAYLOAD}, 0).rgb : vec3(.25);
    color = vec4(shade * (.7 + .3 * facing.y), 1);
    return;
  }
  vec3 radiance = a.rgb * e / ${Math.PI};
  color = mode == 1 ? vec4(radiance * scale, lit || !game) : vec4(tone(radiance * exp2(exposure)), a.a);
}`;

const PAGE_FRAGMENT = `#version 300 es
precision highp float; precision highp int;
uniform sampler2D map, reference, bits; uniform float scale, referenceScale, exposure; uniform int view; uniform vec4 window; uniform ivec2 pageSize; out vec4 color;
${TONE}
void main() {
  vec2 at = (gl_FragCoord.xy * vec2(1, -1) + vec2(0, window.w) - window.xy) * window.z / vec2(pageSize);
  if (any(lessThan(at, vec2(0))) || any(greaterThan(at, vec2(1)))) { color = vec4(.07, .08, .1, 1); return; }
  ivec2 texel = ivec2(at * vec2(pageSize));
  if (view == 3) { color = vec4(texelFetch(bits, texel / ${PAYLOAD}, 0).rgb, 1); return; }
  color = vec4(tone(irradiance((vec2(texel) + .5) / vec2(pageSize)) * .5 / ${Math.PI} * exp2(exposure)), 1);
}`;

// ---- Matrices, column by column ----

function multiply(a, b) {
  const out = new Array(16).fill(0);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

function matrixOf({ matrix, translation: t = [0, 0, 0], rotation: [x, y, z, w] = [0, 0, 0, 1], scale: s = [1, 1, 1] }) {
  if (matrix) return matrix;
  return [
    (1 - 2 * (y * y + z * z)) * s[0], 2 * (x * y + z * w) * s[0], 2 * (x * z - y * w) * s[0], 0,
    2 * (x * y - z * w) * s[1], (1 - 2 * (x * x + z * z)) * s[1], 2 * (y * z + x * w) * s[1], 0,
    2 * (x * z + y * w) * s[2], 2 * (y * z - x * w) * s[2], (1 - 2 * (x * x + y * y)) * s[2], 0, ...t, 1];
}

const apply = (m, p) => [0, 1, 2].map(r => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

// ---- Cameras ----

// A camera at `eye` that looks by yaw and pitch; `distance` ahead lies what it orbits. `fov` is the angle from left to right in degrees.
class Camera {
  constructor(name, eye, target, fov) {
    const to = add(target, eye, -1), distance = Math.hypot(...to) || 1;
    Object.assign(this, { name, eye: [...eye], distance, fov, yaw: Math.atan2(to[0], -to[2]), pitch: Math.asin(to[1] / distance) });
  }
  copy() { return Object.assign(Object.create(Camera.prototype), this, { eye: [...this.eye] }); }
  get forward() {
    const c = Math.cos(this.pitch);
    return [c * Math.sin(this.yaw), Math.sin(this.pitch), -c * Math.cos(this.yaw)];
  }
  get right() { return [Math.cos(this.yaw), 0, Math.sin(this.yaw)]; }
  turn(yaw, pitch, orbits) {
    const target = add(this.eye, this.forward, this.distance);
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -1.55), 1.55);
    if (orbits) this.eye = add(target, this.forward, -this.distance);
  }
  move(right, up, ahead) {
    this.eye = add(add(add(this.eye, this.right, right), cross(this.right, this.forward), up), this.forward, ahead);
  }
  zoom(factor) {
    const nearer = this.distance * factor;
    this.eye = add(this.eye, this.forward, this.distance - nearer);
    this.distance = nearer;
  }
  matrix(width, height, radius) {
    const z = this.forward.map(x => -x), x = this.right, y = cross(z, x), near = Math.max(radius * 2e-4, 0.02), far = 8 * radius + this.distance;
    const view = [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, this.eye), -dot(y, this.eye), -dot(z, this.eye), 1];
    // In tall pictures the angle is that of the longer side.
    const f = 1 / Math.tan(this.fov * Math.PI / 360), [fx, fy] = width >= height ? [f, f * width / height] : [f * height / width, f];
    return multiply([fx, 0, 0, 0, 0, fy, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0], view);
  }
}

// ---- GLB ----

class Scene {
  static async open(gl, bytes, pages) {
    const scene = new Scene();
    await scene.read(gl, bytes, pages);
    return scene;
  }

  async read(gl, bytes, pages) {
    const c = new Cursor(bytes);
    expect(bytes.length >= 20 && c.u32('magic') === 0x46546c67 && c.u32('version') === 2, 'scene.glb is not a glTF 2 binary');
    c.skip(4, 'length');
    const length = c.u32('length of the JSON');
    c.skip(4, 'kind');
    this.json = JSON.parse(new TextDecoder().decode(c.take(length, 'JSON')));
    this.bin = new Uint8Array(0);
    if (c.at < c.end) {
      const size = c.u32('length of the binary');
      c.skip(4, 'kind');
      this.bin = c.take(size, 'binary');
    }
    this.gl = gl;
    this.pages = pages;
    this.buffers = new Map();
    this.cameras = [];
    this.draws = [];
    this.triangles = this.unmapped = 0;
    this.low = [Infinity, Infinity, Infinity];
    this.high = [-Infinity, -Infinity, -Infinity];
    this.white = this.image1();
    this.textures = await Promise.all((this.json.textures ?? []).map(texture => this.texture(texture)));
    this.meshes = new Map();
    const roots = this.json.scenes?.[this.json.scene ?? 0]?.nodes ?? [];
    const left = roots.map(node => [node, IDENTITY, { moves: false, hidden: false }]);
    // A node has one parent: more visits than nodes are a cycle.
    for (let visits = 0; left.length > 0; visits++) {
      expect(visits <= this.json.nodes.length, 'nodes of scene.glb that hold one another');
      const [number, parent, above] = left.pop(), node = this.json.nodes[number], world = multiply(parent, matrixOf(node));
      // What moves is no part of the bake: a game lights it. What is hidden is not drawn, nor what is below it.
      const moves = node.extras?.movable ?? above.moves;
      const hidden = above.hidden || node.extensions?.KHR_node_visibility?.visible === false;
      for (const child of node.children ?? []) left.push([child, world, { moves, hidden }]);
      if (node.mesh !== undefined && !moves && !hidden) this.addMesh(node, world);
      if (node.camera !== undefined) this.addCamera(node, world);
    }
    this.draws.sort((a, b) => a.material.blend - b.material.blend || a.material.index - b.material.index);
    this.radius = this.draws.length ? Math.hypot(...add(this.high, this.low, -1)) / 2 : 1;
    this.middle = this.low.map((low, i) => (low + this.high[i]) / 2);
    this.json = this.bin = null;
    this.program = compile(gl, DRAW_VERTEX, DRAW_FRAGMENT, ['position', 'normal', 'texcoord', 'lightmap', 'tint']);
  }

  image1() {
    const { gl } = this, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255]));
    return texture;
  }

  part(view) {
    const { byteOffset = 0, byteLength } = this.json.bufferViews[view];
    expect(byteOffset + byteLength <= this.bin.length, `view ${view} of scene.glb ends behind its file`);
    return this.bin.subarray(byteOffset, byteOffset + byteLength);
  }

  async texture({ source, sampler }) {
    const { gl } = this, image = this.json.images?.[source], of = this.json.samplers?.[sampler] ?? {};
    if (image?.bufferView === undefined) return this.white;
    const blob = new Blob([this.part(image.bufferView)], { type: image.mimeType });
    const bitmap = await createImageBitmap(blob, { colorSpaceConversion: 'none', premultiplyAlpha: 'none' });
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, of.wrapS ?? gl.REPEAT);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, of.wrapT ?? gl.REPEAT);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    bitmap.close();
    return texture;
  }

  // A view as a buffer of the GPU.
  buffer(target, view) {
    const key = `${target} ${view}`;
    if (!this.buffers.has(key)) {
      const { gl } = this, buffer = gl.createBuffer();
      gl.bindVertexArray(null);
      gl.bindBuffer(target, buffer);
      gl.bufferData(target, this.part(view), gl.STATIC_DRAW);
      this.buffers.set(key, buffer);
    }
    return this.buffers.get(key);
  }

  material(index) {
    const material = this.json.materials?.[index] ?? {}, pbr = material.pbrMetallicRoughness ?? {}, base = [...pbr.baseColorFactor ?? [1, 1, 1, 1]];
    const transmits = material.extensions?.KHR_materials_transmission?.transmissionFactor ?? 0, place = pbr.baseColorTexture?.extensions?.KHR_texture_transform ?? {};
    if (transmits > 0) base[3] *= 1 - 0.8 * transmits;
    const mode = transmits > 0 ? 'BLEND' : material.alphaMode ?? 'OPAQUE';
    if (mode !== 'BLEND') base[3] = mode === 'OPAQUE' ? 1 : base[3];
    return {
      index: index ?? -1, base, twoSided: !!material.doubleSided, blend: mode === 'BLEND', cutoff: mode === 'MASK' ? material.alphaCutoff ?? 0.5 : 0,
      texture: this.textures[pbr.baseColorTexture?.index] ?? this.white, place: [...place.scale ?? [1, 1], ...place.offset ?? [0, 0]],
    };
  }

  primitives(number) {
    if (!this.meshes.has(number)) {
      const all = this.json.meshes[number].primitives.filter(primitive => (primitive.mode ?? 4) === 4 && primitive.attributes.POSITION !== undefined);
      this.meshes.set(number, all.map(primitive => this.primitive(primitive)));
    }
    return this.meshes.get(number);
  }

  primitive({ attributes, indices, material }) {
    const { gl } = this, names = ATTRIBUTES.map(name => attributes[name]), buffers = names.map(index => index === undefined ? null : this.buffer(gl.ARRAY_BUFFER, this.json.accessors[index].bufferView));
    const list = indices === undefined ? null : this.json.accessors[indices], elements = list && this.buffer(gl.ELEMENT_ARRAY_BUFFER, list.bufferView), vertices = gl.createVertexArray();
    gl.bindVertexArray(vertices);
    names.forEach((index, place) => {
      if (index === undefined) return;
      const accessor = this.json.accessors[index], view = this.json.bufferViews[accessor.bufferView], parts = PARTS[accessor.type], { byteOffset = 0 } = accessor;
      const stride = view.byteStride ?? parts * SIZES[accessor.componentType];
      expect(byteOffset + stride * (accessor.count - 1) + parts * SIZES[accessor.componentType] <= view.byteLength, `accessor ${index} of scene.glb ends behind its view`);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[place]);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, parts, accessor.componentType, !!accessor.normalized, stride, byteOffset);
    });
    if (elements) gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, elements);
    gl.bindVertexArray(null);
    const { min, max, count } = this.json.accessors[attributes.POSITION];
    return { vertices, min, max, mapped: attributes.TEXCOORD_1 !== undefined, material: this.material(material), count: list?.count ?? count, type: list?.componentType, offset: list?.byteOffset ?? 0 };
  }

  addMesh(node, world) {
    const { lightmapPage: page, lightmapScale: scale, lightmapOffset: offset } = node.extras ?? {};
    for (const primitive of this.primitives(node.mesh)) {
      const mapped = primitive.mapped && page >= 0 && page < this.pages && !!scale && !!offset;
      const m = world, flips = dot(cross([m[0], m[1], m[2]], [m[4], m[5], m[6]]), [m[8], m[9], m[10]]) < 0;
      this.draws.push({ ...primitive, world, flips, mapped, page: mapped ? page : 0, place: mapped ? [...scale, ...offset] : [0, 0, 0, 0] });
      this.triangles += primitive.count / 3;
      if (!mapped) this.unmapped += primitive.count / 3;
      for (let corner = 0; mapped && corner < 8 && primitive.min; corner++) {
        const at = apply(world, [0, 1, 2].map(i => (corner >> i & 1 ? primitive.max : primitive.min)[i]));
        at.forEach((x, i) => { this.low[i] = Math.min(this.low[i], x); this.high[i] = Math.max(this.high[i], x); });
      }
    }
  }

  addCamera(node, world) {
    const lens = this.json.cameras?.[node.camera]?.perspective;
    if (!lens) return;
    const eye = apply(world, [0, 0, 0]), ahead = apply(world, [0, 0, -5]), fov = 2 * Math.atan(Math.tan(lens.yfov / 2) * (lens.aspectRatio ?? 16 / 9));
    this.cameras.push(new Camera(node.name ?? `camera ${this.cameras.length + 1}`, eye, ahead, Math.min(fov * 180 / Math.PI, 150)));
  }

  // From above the south-west, as bake preview looks at scenes without a camera.
  overview() {
    const d = this.radius / Math.sin(Math.PI / 6), way = [-0.6, 0.6, 1].map(x => x / Math.hypot(0.6, 0.6, 1));
    return new Camera('overview', add(this.middle, way, d), this.middle, 60);
  }

  // Draws into the bound framebuffer. `mode` 0: as a screen shows it; 1: radiance × the pages' scale, with alpha 0 where nothing counts for the exposure; 2: page, u and v, with no page where a surface has no texels. `state` has what to show, and where; its `game` leaves surfaces without texels black.
  draw(camera, width, height, mode, state) {
    const { gl } = this, { program, at } = this.program, clip = camera.matrix(width, height, Math.max(this.radius, 1e-3));
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);
    const sky = mode ? [0, 0, 0, 0] : [0.07, 0.08, 0.1, 1];
    gl.clearColor(...sky);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    ['map', 'reference', 'bits', 'albedo'].forEach((name, unit) => gl.uniform1i(at[name], unit));
    gl.uniform1f(at.scale, state.scale);
    gl.uniform1f(at.exposure, state.exposure);
    gl.uniform3fv(at.ambient, state.ambient);
    gl.uniform1i(at.view, mode === 2 ? 0 : VIEWS.indexOf(state.view));
    gl.uniform1i(at.mode, mode);
    gl.uniform1i(at.game, state.game ? 1 : 0);
    gl.vertexAttrib4f(4, 1, 1, 1, 1);
    let page = -1, material = null, blends = false;
    gl.disable(gl.BLEND);
    const bind = (unit, texture) => { gl.activeTexture(gl.TEXTURE0 + unit); gl.bindTexture(gl.TEXTURE_2D, texture); };
    for (const draw of this.draws) {
      if (draw.page !== page) {
        page = draw.page;
        bind(0, state.pages[page].texture);
        bind(1, state.pages[page].reference ?? state.pages[page].texture);
        bind(2, state.pages[page].bits);
        gl.uniform1f(at.referenceScale, state.pages[page].referenceScale ?? 1);
        gl.uniform2i(at.pageSize, state.pages[page].width, state.pages[page].height);
        gl.uniform1f(at.page, page);
      }
      if (draw.material !== material) {
        material = draw.material;
        bind(3, material.texture);
        gl.uniform4fv(at.base, material.base);
        gl.uniform4fv(at.uvPlace, material.place);
        gl.uniform1f(at.cutoff, material.cutoff);
        material.twoSided ? gl.disable(gl.CULL_FACE) : gl.enable(gl.CULL_FACE);
        if (material.blend && mode !== 2 && !blends) {
          blends = true;
          gl.enable(gl.BLEND);
          gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
          gl.depthMask(false);
        }
      }
      if (mode === 2 && material.blend) continue;
      const m = draw.world;
      gl.frontFace(draw.flips ? gl.CW : gl.CCW);
      gl.uniform1i(at.mapped, draw.mapped ? 1 : 0);
      gl.uniform4fv(at.place, draw.place);
      gl.uniformMatrix4fv(at.clip, false, multiply(clip, m));
      gl.uniformMatrix3fv(at.turn, false, [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]);
      gl.bindVertexArray(draw.vertices);
      draw.type ? gl.drawElements(gl.TRIANGLES, draw.count, draw.type, draw.offset) : gl.drawArrays(gl.TRIANGLES, 0, draw.count);
    }
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
  }
}

// The exposure that suits radiances: bake preview's. Their log-average luminance becomes 0.18, their 95th percentile at most 1.
function automaticExposure(luminances) {
  const sorted = Float64Array.from(luminances).sort(), n = Math.max(sorted.length, 1), mean = sorted.reduce((a, b) => a + b, 0) / n;
  if (!(mean > 0) || !Number.isFinite(mean)) return 0;
  const average = sorted.reduce((sum, l) => sum + Math.log2(Math.max(l, 0.01 * mean)), 0) / n;
  const bright = sorted[Math.floor((sorted.length - 1) * 95 / 100)];
  return Math.min(Math.log2(0.18) - average, -Math.log2(Math.max(bright, 0.01 * mean)));
}
