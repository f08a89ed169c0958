
// A square whose light map shows the centre of one texel of the page, seen by a camera of its own.
try {
  codebook = await files('words');
  const bundle = openBundle(await files('bundle')), renderer = new THREE.WebGLRenderer(), scene = new THREE.Scene();
  const geometry = new THREE.PlaneGeometry(2, 2), count = geometry.attributes.uv.count;
  geometry.setAttribute('uv1', new THREE.BufferAttribute(new Float32Array(2 * count).fill(0.5), 2));
  const shared = new THREE.MeshLambertMaterial({ color: new THREE.Color().setRGB(0.5, 0.5, 0.5, THREE.LinearSRGBColorSpace) }), square = new THREE.Mesh(geometry, shared), other = new THREE.Mesh(geometry, shared);
  light(square, lightMapOf(bundle, 0, 9.3, 1 / 64), { lightmapScale: [0.1, 0.1], lightmapOffset: [75.5 / 300 - 0.05, 105.5 / 140 - 0.05] });
  // Another mesh of the same material has another part of the page.
  light(other, square.material.lightMap, { lightmapScale: [0.1, 0.1], lightmapOffset: [0, 0] });
  scene.add(square);
  const target = new THREE.WebGLRenderTarget(4, 4, { type: THREE.FloatType }), shown = new Float32Array(4);
  renderer.setRenderTarget(target);
  renderer.render(scene, new THREE.OrthographicCamera(-1, 1, 1, -1, -1, 1));
  renderer.readRenderTargetPixels(target, 2, 2, 1, 1, shown);
  report({ shown: [...shown] });
} catch (problem) {
  report({ problem: String(problem.stack) });
}
