// Decodes tiles on the GPU: a fragment shader per tile writes E × scale of its own texels into the page's texture. All filtering of
// features is done in the shader, on single texels; the hardware's has 8-bit fractions.
'use strict';

const BC7 = 0x8e8c;
// Textures of maps may take this many bytes: grey blocks that are left out count.
const MOST_BYTES = 2 ** 30;

const COVER = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4. - 1., 0, 1); }`;

// The decoder of a tile's light: of its maps, then of the sun.
function decodeShader(maps) {
  return `#version 300 es
precision highp float; precision highp int; precision highp sampler2DArray; precision highp isampler2D; precision highp isampler2DArray; precision highp usampler2DArray;
uniform isampler2D normals; uniform usampler2DArray seen;
uniform ivec2 origin; uniform bool lit, sunny; uniform float scale, most, seenShare; uniform vec3 sun, direction;
out vec4 color;
${maps}
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy) - origin; vec3 light = vec3(0);
  if (lit) light = maps(p);
  if (sunny) {
    int channels = textureSize(seen, 0).z; vec3 share; 
    for (int c = 0; c < 3; c++) { vec2 v = vec2(texelFetch(seen, ivec3(p, min(c, channels - 1)), 0).xy); share[c] = mix(v.x, v.y, seenShare) / ${SEEN}.; }
    light += share * max(dot(vec3(texelFetch(normals, p, 0).xyz) / 32767., direction), 0.) * sun;
  }
  color = vec4(min(light * scale, most), 1);
}`;
}

// Planes: per light source a row of its mean and the number of planes (−1 less that if it is linear), then the factors of each and its layer.
const OF_PLANES = `
uniform isampler2DArray values; uniform sampler2D factors; uniform int sources;
vec3 maps(ivec2 p) {
  vec3 light = vec3(0);
  for (int s = 0; s < sources; s++) {
    vec4 mean = texelFetch(factors, ivec2(0, s), 0), sum = vec4(0); int count = int(mean.a < 0. ? -1. - mean.a : mean.a);
    for (int k = 0; k < count; k++) { vec4 of = texelFetch(factors, ivec2(1 + k, s), 0); sum += of * float(texelFetch(values, ivec3(p, int(of.a)), 0).x); }
    vec3 y = clamp(sum.rgb, 0., 65504.);
    light += mean.rgb * (mean.a < 0. ? y : y * y);
  }
  return light;
}`;

// The network for hidden layers of h: its weights are uniforms for 16, where they fit, else a texture.
function network(h) {
  const q = h / 4, w2 = 3 * h, b2 = w2 + h * q, w3 = b2 + q, b3 = w3 + 3 * q;
  const net = h === 16 ? ['uniform vec4 weights[' + (b3 + 1) + '];', i => `weights[${i}]`]
    : ['uniform sampler2D weights; vec4 weight(int i) { return texelFetch(weights, ivec2(i & 63, i >> 6), 0); }', i => `weight(${i})`];
  return `
uniform sampler2D uv, ut, vt; uniform sampler2DArray uvt;
${net[0]}
uniform vec4 bias[${q}];
uniform ivec2 size, uvtSize, slices, rows; uniform vec2 planes, shares; uniform vec3 mean;
vec4 gelu(vec4 x) { vec4 z = clamp(x, -2.25, 2.25); return x * (.5 + z * (1. / 3. - 16. / 729. * z * z)); }
float place(int i, int side, float n) { return clamp((float(i) + .5) / float(side) * n - .5, 0., n - 1.); }
vec2 plane(sampler2D map, int i, int side, float n) {
  float s = place(i, side, n); int a = int(s), b = min(a + 1, int(n) - 1); s -= float(a);
  vec2 first = mix(texelFetch(map, ivec2(a, rows.x), 0).xy, texelFetch(map, ivec2(b, rows.x), 0).xy, s);
  return mix(first, mix(texelFetch(map, ivec2(a, rows.y), 0).xy, texelFetch(map, ivec2(b, rows.y), 0).xy, s), shares.y);
}
vec4 slice(ivec2 p) { return mix(texelFetch(uvt, ivec3(p, slices.x), 0), texelFetch(uvt, ivec3(p, slices.y), 0), shares.x); }
vec3 maps(ivec2 p) {
  vec2 s = vec2(place(p.x, size.x, float(uvtSize.x)), place(p.y, size.y, float(uvtSize.y)));
  ivec2 low = ivec2(s), high = min(low + 1, uvtSize - 1); s -= vec2(low);
  vec4 a = mix(mix(slice(low), slice(ivec2(high.x, low.y)), s.x), mix(slice(ivec2(low.x, high.y)), slice(high), s.x), s.y);
  vec4 b = texelFetch(uv, min(p, textureSize(uv, 0) - 1), 0);
  vec4 c = vec4(plane(ut, p.x, size.x, planes.x), plane(vt, p.y, size.y, planes.y));
  a = 3. * (a - .5); b = 3. * (b - .5); c = 3. * (c - .5);
${layers(h, net[1])}
  y = clamp(y, 0., 65504.);
  return mean * (y * y);
}`;
}

// The three layers, written out: loops over arrays cost software renderers more than twice as much. At width 64 the text would be so long that they
// compile it for over ten seconds, and browsers take the context away.
function layers(h, weight) {
  if (h === 64) return loops(h, weight);
  const q = h / 4, w2 = 3 * h, b2 = w2 + h * q, w3 = b2 + q, b3 = w3 + 3 * q, range = Array.from({ length: q }, (_, i) => i);
  const dots = (from, inputs) => inputs.map((input, i) => `dot(${weight(from + i)}, ${input})`).join(' + ');
  const row = (bias, from, inputs) => `${bias} + vec4(${[0, 1, 2, 3].map(k => dots(from(k), inputs)).join(', ')})`;
  const first = range.map(i => `f${i}`), second = range.map(i => `s${i}`);
  return [
    ...range.map(r => `  vec4 f${r} = gelu(${row(`bias[${r}]`, k => 3 * (4 * r + k), ['a', 'b', 'c'])});`),
    ...range.map(r => `  vec4 s${r} = gelu(${row(weight(b2 + r), k => w2 + q * (4 * r + k), first)});`),
    `  vec3 y = ${weight(b3)}.xyz + vec3(${[0, 1, 2].map(k => dots(w3 + q * k, second)).join(', ')});`,
  ].join('\n');
}

function loops(h, weight) {
  const q = h / 4, w2 = 3 * h, b2 = w2 + h * q, w3 = b2 + q, b3 = w3 + 3 * q;
  return `
  vec4 f[${q}]; vec3 y = ${weight(b3)}.xyz;
  for (int r = 0; r < ${q}; r++) {
    vec4 sum = bias[r];
    for (int k = 0; k < 4; k++) {
      int at = 3 * (4 * r + k);
      sum[k] += dot(${weight('at')}, a) + dot(${weight('at + 1')}, b) + dot(${weight('at + 2')}, c);
    }
    f[r] = gelu(sum);
  }
  for (int r = 0; r < ${q}; r++) {
    vec4 sum = ${weight(`${b2} + r`)};
    for (int k = 0; k < 4; k++) for (int i = 0; i < ${q}; i++) sum[k] += dot(${weight(`${w2} + ${q} * (4 * r + k) + i`)}, f[i]);
    sum = gelu(sum);
    y += vec3(dot(${weight(`${w3} + r`)}, sum), dot(${weight(`${w3 + q} + r`)}, sum), dot(${weight(`${w3 + 2 * q} + r`)}, sum));
  }`;
}

function compile(gl, vertex, fragment, attributes = []) {
  const program = gl.createProgram(), shaders = [];
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    shaders.push(shader);
  }
  attributes.forEach((name, i) => gl.bindAttribLocation(program, i, name));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) refuse(`a shader does not compile: ${[gl.getProgramInfoLog(program), ...shaders.map(shader => gl.getShaderInfoLog(shader))].join(' ')}`);
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(program, i).name.replace('[0]', '');
    places[name] = gl.getUniformLocation(program, name);
  }
  return { program, at: places };
}

class Decoder {
  // `options.unpack`: do without the hardware's BC7. `options.float`: pages of 32-bit floats.
  constructor(gl, bundle, options = {}) {
    this.gl = gl;
    this.bundle = bundle;
    const float = gl.getExtension('EXT_color_buffer_float');
    if (!float && !gl.getExtension('EXT_color_buffer_half_float')) refuse('this browser cannot draw into half floats');
    this.bptc = options.unpack ? null : gl.getExtension('EXT_texture_compression_bptc');
    this.format = options.float && float ? gl.RGBA32F : gl.RGBA16F;
    this.most = this.format === gl.RGBA32F ? LARGEST : 65504;
    this.programs = new Map();
    this.scale = 0;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const side = gl.getParameter(gl.MAX_TEXTURE_SIZE), large = bundle.pages.find(page => Math.max(page.width, page.height) > side);
    if (large) refuse(`a page of ${large.width} × ${large.height} texels; this browser's textures have ${side} on a side`);
    this.pages = bundle.pages.map(page => this.target(page.width, page.height, this.format));
    this.none = {
      flat: this.texture(gl.TEXTURE_2D, gl.RGBA8, 1, 1), deep: this.texture(gl.TEXTURE_2D_ARRAY, gl.RGBA8, 1, 1, 1),
      normals: this.texture(gl.TEXTURE_2D, gl.RGBA16I, 1, 1), seen: this.texture(gl.TEXTURE_2D_ARRAY, gl.RG8UI, 1, 1, 1),
    };
    this.vertices = gl.createVertexArray();
    let bytes = 0;
    const layers = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    for (const tile of bundle.tiles) {
      if (tile.features) bytes += blocksOf(tile.has, tile).reduce((a, b) => a + b) * (this.bptc ? 16 : 64);
      if (!tile.planes) continue;
      bytes += 2 * tile.width * tile.height * tile.planes.word;
      if (tile.planes.word > layers) refuse(`${tile.planes.word} planes of a tile; this browser's textures have ${layers} layers`);
    }
    if (bytes > MOST_BYTES) refuse(`maps of ${bytes} bytes; this page holds ${MOST_BYTES} at most`);
  }

  texture(target, format, width, height, layers) {
    const { gl } = this, texture = gl.createTexture();
    gl.bindTexture(target, texture);
    if (layers) gl.texStorage3D(target, 1, format, width, height, layers);
    else gl.texStorage2D(target, 1, format, width, height);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, filter, gl.NEAREST);
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, wrap, gl.CLAMP_TO_EDGE);
    return texture;
  }

  // A texture to draw into, filtered when read, all black.
  target(width, height, format) {
    const { gl } = this, texture = this.texture(gl.TEXTURE_2D, format, width, height), frame = gl.createFramebuffer();
    if (format === gl.RGBA16F) for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    return { texture, frame, width, height };
  }

  blocks(target, map, width, height, slices) {
    const { gl } = this, deep = target === gl.TEXTURE_2D_ARRAY, texture = this.texture(target, this.bptc ? BC7 : gl.RGBA8, width, height, deep ? slices : 0);
    const dense = denseBlocks(map);
    if (this.bptc && deep) gl.compressedTexSubImage3D(target, 0, 0, 0, 0, width, height, slices, BC7, dense);
    else if (this.bptc) gl.compressedTexSubImage2D(target, 0, 0, 0, width, height, BC7, dense);
    else if (deep) gl.texSubImage3D(target, 0, 0, 0, 0, width, height, slices, gl.RGBA, gl.UNSIGNED_BYTE, unpackBlocks(dense, width, height, slices));
    else gl.texSubImage2D(target, 0, 0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, unpackBlocks(dense, width, height, 1));
    return texture;
  }

  // What of a tile stays on the GPU.
  resident(tile) {
    if (tile.gpu) return tile.gpu;
    const { gl } = this, own = {};
    if (tile.features) {
      const read = featuresOf(this.bundle, tile), { has } = read;
      if (read.uv) own.uv = this.blocks(gl.TEXTURE_2D, read.uv, tile.width, tile.height, 1);
      if (read.uvt) own.uvt = this.blocks(gl.TEXTURE_2D_ARRAY, read.uvt, has.uvtWidth, has.uvtHeight, has.slices);
      for (const [name, side] of [['ut', tile.width], ['vt', tile.height]]) {
        if (!read[name]) continue;
        own[name] = this.texture(gl.TEXTURE_2D, gl.RG8, Math.ceil(side / 2), has.rows);
        gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, Math.ceil(side / 2), has.rows, gl.RG, gl.UNSIGNED_BYTE, read[name]);
      }
      own.weights = packWeights(read);
      if (has.hidden > 16) {
        const rows = Math.ceil(own.weights.length / 256), padded = new Float32Array(256 * rows);
        padded.set(own.weights);
        own.net = this.texture(gl.TEXTURE_2D, gl.RGBA32F, 64, rows);
        gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 64, rows, gl.RGBA, gl.FLOAT, padded);
      }
    }
    if (tile.planes) {
      const sources = planesOf(this.bundle, tile), planes = sources.flatMap(source => source.values);
      own.values = this.texture(gl.TEXTURE_2D_ARRAY, gl.R16I, tile.width, tile.height, Math.max(planes.length, 1));
      planes.forEach((values, k) => gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, k, tile.width, tile.height, 1, gl.RED_INTEGER, gl.SHORT, values));
      own.factors = this.texture(gl.TEXTURE_2D, gl.RGBA32F, 1 + MOST_PLANES, Math.max(sources.length, 1));
      forgetPlanes(tile);
    }
    if (tile.levels) {
      const sun = readTileSun(this.bundle, tile);
      if (sun.normals) {
        const texels = tile.width * tile.height, data = new Int16Array(4 * texels);
        for (let i = 0; i < texels; i++) for (let k = 0; k < 3; k++) data[4 * i + k] = Math.round(32767 * sun.normals[3 * i + k]);
        own.normals = this.texture(gl.TEXTURE_2D, gl.RGBA16I, tile.width, tile.height);
        gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, tile.width, tile.height, gl.RGBA_INTEGER, gl.SHORT, data);
        own.seen = this.texture(gl.TEXTURE_2D_ARRAY, gl.RG8UI, tile.width, tile.height, Math.max(sun.channels, 1));
      }
    }
    return tile.gpu = own;
  }

  uploadSeen(tile, sun) {
    const { gl } = this;
    if (tile.gpu.key === sun.key) return;
    tile.gpu.key = sun.key;
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, tile.gpu.seen);
    sun.planes.forEach(([a, b], layer) => {
      const data = new Uint8Array(2 * a.length);
      for (let i = 0; i < a.length; i++) { data[2 * i] = a[i]; data[2 * i + 1] = b[i]; }
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, tile.width, tile.height, 1, gl.RG_INTEGER, gl.UNSIGNED_BYTE, data);
    });
  }

  // For hidden layers of this width, or 0 for planes.
  program(hidden) {
    if (!this.programs.has(hidden)) {
      const { gl } = this, made = compile(gl, COVER, decodeShader(hidden ? network(hidden) : OF_PLANES));
      gl.useProgram(made.program);
      const units = { ...hidden ? { uv: 0, ut: 1, vt: 2, uvt: 3 } : { factors: 0, values: 3 }, normals: 4, seen: 5 };
      for (const [name, unit] of Object.entries(units)) gl.uniform1i(made.at[name], unit);
      if (hidden > 16) gl.uniform1i(made.at.weights, 6);
      this.programs.set(hidden, made);
    }
    return this.programs.get(hidden);
  }

  // Means and factors of what is lit, as the shader reads them.
  uploadFactors(own, folded) {
    const { gl } = this, width = 1 + MOST_PLANES, data = new Float32Array(4 * width * folded.length);
    folded.forEach(({ source, mean, factors }, row) => {
      const put = (x, rgb, more) => data.set([...rgb, more], 4 * (width * row + x));
      put(0, mean, source.linear ? -1 - source.count : source.count);
      for (let k = 0; k < source.count; k++) put(1 + k, factors.map(of => of[k]), source.layer + k);
    });
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, own.factors);
    if (folded.length) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, folded.length, gl.RGBA, gl.FLOAT, data);
  }

  // Draws a tile where the viewport is; texel (x, y) of the viewport's texture is stored texel (x, y) − origin.
  draw(tile, moment, sun, origin, scale) {
    const { gl, bundle } = this, own = this.resident(tile), read = tile.read, has = read?.has, { program, at } = this.program(has?.hidden ?? (tile.planes ? 0 : 16));
    if (sun) this.uploadSeen(tile, sun);
    gl.useProgram(program);
    gl.bindVertexArray(this.vertices);
    const bind = (unit, target, texture) => { gl.activeTexture(gl.TEXTURE0 + unit); gl.bindTexture(target, texture); };
    bind(0, gl.TEXTURE_2D, own.factors ?? own.uv ?? this.none.flat);
    bind(1, gl.TEXTURE_2D, own.ut ?? this.none.flat);
    bind(2, gl.TEXTURE_2D, own.vt ?? this.none.flat);
    bind(3, gl.TEXTURE_2D_ARRAY, own.values ?? own.uvt ?? this.none.deep);
    bind(4, gl.TEXTURE_2D, own.normals ?? this.none.normals);
    bind(5, gl.TEXTURE_2D_ARRAY, own.seen ?? this.none.seen);
    gl.uniform1i(at.lit, read || tile.planes ? 1 : 0);
    gl.uniform1i(at.sunny, sun ? 1 : 0);
    gl.uniform2iv(at.origin, origin);
    gl.uniform1f(at.scale, scale);
    gl.uniform1f(at.most, this.most);
    if (tile.planes) {
      const folded = foldPlanes(bundle, tile, moment);
      this.uploadFactors(own, folded);
      gl.uniform1i(at.sources, folded.length);
    }
    if (read) {
      gl.uniform2i(at.size, tile.width, tile.height);
      const folded = foldTile(bundle, tile, moment), { slices, rows } = folded;
      if (has.hidden > 16) bind(6, gl.TEXTURE_2D, own.net);
      else gl.uniform4fv(at.weights, own.weights);
      gl.uniform4fv(at.bias, folded.bias);
      gl.uniform3fv(at.mean, folded.mean);
      gl.uniform2i(at.uvtSize, Math.max(has.uvtWidth, 1), Math.max(has.uvtHeight, 1));
      gl.uniform2f(at.planes, has.ut ? Math.ceil(tile.width / 2) : 1, has.vt ? Math.ceil(tile.height / 2) : 1);
      gl.uniform2i(at.slices, slices?.first ?? 0, slices?.second ?? 0);
      gl.uniform2i(at.rows, rows?.first ?? 0, rows?.second ?? 0);
      gl.uniform2f(at.shares, slices?.share ?? 0, rows?.share ?? 0);
    }
    if (sun) {
      gl.uniform1f(at.seenShare, sun.share);
      gl.uniform3fv(at.sun, sun.irradiance);
      gl.uniform3fv(at.direction, sun.direction);
    }
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Decodes all pages at an hour; tiles whose light is as it was are left alone. The number of tiles drawn.
  decode(hour) {
    const { gl, bundle } = this, moment = momentOf(bundle, hour), scale = this.scaleAt(moment);
    let drawn = 0;
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.disable(gl.BLEND);
    for (const tile of bundle.tiles) {
      if (!tile.features && !tile.planes && !tile.levels) continue;
      if (tile.features) featuresOf(bundle, tile);
      const sun = tile.levels && sunOf(bundle, tile, moment.t), key = this.keyOf(tile, moment, sun, scale), page = this.pages[tile.page];
      if (tile.shown === key) continue;
      gl.bindFramebuffer(gl.FRAMEBUFFER, page.frame);
      gl.viewport(PAYLOAD * tile.column, PAYLOAD * tile.row, tile.ownWidth, tile.ownHeight);
      this.draw(tile, moment, sun, [PAYLOAD * tile.column - 1, PAYLOAD * tile.row - 1], scale);
      tile.shown = key;
      drawn++;
    }
    this.scale = scale;
    return drawn;
  }

  // Everything that a tile's light depends on.
  keyOf(tile, moment, sun, scale) {
    let of = [];
    if (tile.features) of = Object.values(foldTile(this.bundle, tile, moment)).slice(0, 3);
    if (tile.planes) {
      this.resident(tile);
      of = foldPlanes(this.bundle, tile, moment).flatMap(({ source, mean, factors }) => [source.source, mean, ...factors]);
    }
    return [scale, ...of.map(String), sun ? `${sun.key} ${sun.share} ${sun.direction} ${sun.irradiance}` : ''].join(' ');
  }

  // The power of two that brings the brightest tile's mean, or the sun, to 4 … 8: halves keep 11 bits from there down to 1e-5 of it.
  scaleAt(moment) {
    const { bundle } = this;
    let top = 0;
    for (const tile of bundle.tiles) {
      if (tile.means) top = Math.max(top, ...allMeansAt(bundle, tile, moment));
    }
    const sun = bundle.sun && sunAt(bundle.sun, moment.t);
    if (sun) top = Math.max(top, ...sun.irradiance);
    return top > 0 ? 2 ** Math.min(Math.max(3 - Math.ceil(Math.log2(top)), -100), 100) : 1;
  }

  // What a tile stores, as the GPU decodes it: width × height × 3.
  readTile(tile, hour) {
    const { gl, bundle } = this, moment = momentOf(bundle, hour), scale = this.scaleAt(moment);
    const target = this.target(tile.width, tile.height, this.format), out = new Float32Array(4 * tile.width * tile.height);
    if (tile.features) featuresOf(bundle, tile);
    gl.disable(gl.DEPTH_TEST);
    gl.viewport(0, 0, tile.width, tile.height);
    this.draw(tile, moment, tile.levels && sunOf(bundle, tile, moment.t), [0, 0], scale);
    gl.readPixels(0, 0, tile.width, tile.height, gl.RGBA, gl.FLOAT, out);
    gl.deleteFramebuffer(target.frame);
    gl.deleteTexture(target.texture);
    return Float32Array.from({ length: 3 * tile.width * tile.height }, (_, i) => out[4 * Math.floor(i / 3) + i % 3] / scale);
  }
}

// W₁'s columns of features as three vec4 a row (zeros for what the tile lacks), then W₂, b₂, W₃, b₃.
function packWeights({ has, weights: [w1, , w2, b2, w3, b3] }) {
  const columns = [[has.side, 0, 4], [has.uv, 4, 4], [has.ut, 8, 2], [has.vt, 10, 2]], first = new Float32Array(12 * has.hidden);
  for (let row = 0; row < has.hidden; row++) {
    let from = row * has.inputs;
    for (const [there, to, count] of columns) if (there) for (let k = 0; k < count; k++) first[12 * row + to + k] = w1[from++];
  }
  return Float32Array.from([...first, ...w2, ...b2, ...w3, ...b3, 0]);
}
