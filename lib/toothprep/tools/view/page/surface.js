// The tooth: blocks of triangles that are replaced one by one, shaded by tissue, cut by a section.
//
// A fragment takes the tissue that is strongest among its corners', so that borders are sharp and
// run between the vertices. Where a section opens the solid, the inside of its far wall is what is
// seen: those pixels are marked (stencil), and the section's face is drawn there, coloured by the
// volume of tissues. So the face is right whatever has been cut.
'use strict';

const kRamp = 17;

View.surfaceUniforms = () => ({
  colours: {value: [0, 1, 2, 3, 4].map(() => new THREE.Color(0.66, 0.63, 0.58))},
  section: {value: new THREE.Vector4(0, 0, 0, 0)},  // normal and offset; what lies beyond is away
  wipe: {value: new THREE.Vector2(-1e9, 1e9)},      // pixels from the left between which it shows
  volume: {value: null},
  volumeOrigin: {value: new THREE.Vector3()},
  volumeSize: {value: new THREE.Vector3(1, 1, 1)},
  ramp: {value: Array.from({length: kRamp}, () => new THREE.Color(1, 1, 1))},  // of the deviation
  deviates: {value: 0},                             // 1: coloured by it, where it is known
});

const kSurfaceVertex = `
  attribute vec4 shape;
  varying vec3 place;
  varying vec3 outward;
  varying vec4 tissue;
  varying vec2 deviation;  // of the full colours; whether it is known
  void main() {
    float code = floor(shape.w * 32767.0 + 0.5), label = mod(code, 8.0), steps = floor(code / 8.0);
    deviation = steps > 0.5 ? vec2((steps - 2048.0) / 2047.0, 1.0) : vec2(0.0);
    tissue = vec4(label == 1.0, label == 2.0, label == 3.0, label == 4.0);
    place = position;
    outward = (viewMatrix * vec4(shape.xyz, 0.0)).xyz;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;

const kSurfaceStart = `
  #define RAMP ${kRamp}
  precision highp sampler3D;
  uniform vec3 colours[5];
  uniform vec4 section;
  uniform vec2 wipe;
  varying vec3 place;
  varying vec3 outward;
  varying vec4 tissue;
  varying vec2 deviation;
  uniform vec3 ramp[RAMP];
  uniform float deviates;

  vec3 strongest(vec4 weights, float blur) {
    float most = max(max(weights.x, weights.y), max(weights.z, weights.w));
    if (most <= 0.0) return colours[0];
    vec4 share = smoothstep(most - blur, most, weights);
    share /= share.x + share.y + share.z + share.w;
    return share.x * colours[1] + share.y * colours[2] + share.z * colours[3] + share.w * colours[4];
  }
  vec4 shown(vec3 colour) { return vec4(pow(clamp(colour, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0); }
  bool away() {
    return gl_FragCoord.x < wipe.x || gl_FragCoord.x > wipe.y || dot(section.xyz, place) > section.w;
  }`;

const kOutside = `${kSurfaceStart}
  vec3 lit(vec3 colour, vec3 normal) {
    float key = max(dot(normal, normalize(vec3(-0.35, 0.55, 0.75))), 0.0);
    float fill = max(dot(normal, normalize(vec3(0.6, -0.2, 0.6))), 0.0);
    float shine = pow(max(dot(normal, normalize(vec3(-0.18, 0.28, 0.94))), 0.0), 40.0);
    return colour * (0.16 + 0.72 * key + 0.18 * fill) + 0.10 * shine;
  }
  void main() {
    float blur = clamp(1.5 * max(max(fwidth(tissue.x), fwidth(tissue.y)), fwidth(tissue.z)), 1e-4, 0.5);
    if (away()) discard;
    vec3 colour = strongest(tissue, blur);
    if (deviates > 0.5) {
      float at = clamp(0.5 + 0.5 * deviation.x, 0.0, 1.0) * float(RAMP - 1);
      int i = int(min(floor(at), float(RAMP - 2)));
      colour = deviation.y > 0.99 ? mix(ramp[i], ramp[i + 1], at - float(i)) : colours[0];
    }
    gl_FragColor = shown(lit(colour, normalize(outward)));
  }`;

const kInside = `${kSurfaceStart}
  void main() {
    if (away()) discard;
    gl_FragColor = vec4(0.0, 0.0, 0.0, 1.0);
  }`;

const kFaceVertex = `
  varying vec3 place;
  varying vec3 outward;
  varying vec4 tissue;
  varying vec2 deviation;
  void main() {
    deviation = vec2(0.0);
    place = (modelMatrix * vec4(position, 1.0)).xyz;
    outward = normalMatrix * normal;
    tissue = vec4(0.0);
    gl_Position = projectionMatrix * viewMatrix * vec4(place, 1.0);
  }`;

const kFace = `${kSurfaceStart}
  uniform sampler3D volume;
  uniform vec3 volumeOrigin;
  uniform vec3 volumeSize;
  void main() {
    vec4 inside = texture(volume, (place - volumeOrigin) / volumeSize) - 0.25;
    float blur = clamp(0.7 * (fwidth(inside.x) + fwidth(inside.y) + fwidth(inside.z)), 1e-4, 0.05);
    gl_FragColor = shown(0.9 * strongest(inside, blur) * (0.45 + 0.55 * abs(normalize(outward).z)));
  }`;

View.Surface = class {
  constructor() {
    this.group = new THREE.Group();
    this.uniforms = View.surfaceUniforms();
    const material = (fragmentShader, side, mark) => new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: kSurfaceVertex, fragmentShader, side,
      stencilWrite: true, stencilRef: mark, stencilZPass: THREE.ReplaceStencilOp,
    });
    this.outside = material(kOutside, THREE.FrontSide, 0);
    this.inside = material(kInside, THREE.BackSide, 1);
    this.insides = new THREE.Group();  // drawn with a section only
    this.insides.visible = false;
    this.group.add(this.insides);
    this.blocks = new Map();
    this.triangles = 0;
    this.frame = -1;
  }
  // Takes what readBlocks() gave.
  update(update) {
    for (const block of update.blocks) {
      const old = this.blocks.get(block.key);
      if (old) {
        this.triangles -= old[0].geometry.index.count / 3;
        this.group.remove(old[0]);
        this.insides.remove(old[1]);
        old[0].geometry.dispose();
        this.blocks.delete(block.key);
      }
      if (block.indices.length === 0) continue;
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.BufferAttribute(block.positions, 3));
      geometry.setAttribute('shape', new THREE.BufferAttribute(block.shapes, 4, true));
      geometry.setIndex(new THREE.BufferAttribute(block.indices, 1));
      geometry.computeBoundingSphere();
      const meshes = [new THREE.Mesh(geometry, this.outside), new THREE.Mesh(geometry, this.inside)];
      for (const mesh of meshes) mesh.matrixAutoUpdate = false;
      this.blocks.set(block.key, meshes);
      this.group.add(meshes[0]);
      this.insides.add(meshes[1]);
      this.triangles += block.indices.length / 3;
    }
    this.frame = update.frame;
  }
};

// The face of a section: drawn where the inside of a surface is what would be seen.
View.sectionFace = (uniforms, size) => {
  const material = new THREE.ShaderMaterial({
    uniforms, vertexShader: kFaceVertex, fragmentShader: kFace, side: THREE.DoubleSide, depthFunc: THREE.AlwaysDepth,
    stencilWrite: true, stencilFunc: THREE.EqualStencilFunc, stencilRef: 1,
  });
  const face = new THREE.Mesh(new THREE.PlaneBufferGeometry(size, size), material);
  face.renderOrder = 1;  // after the surfaces
  face.visible = false;
  return face;
};

// The volume of tissues as a texture for section faces; without one, faces have the plain colour.
View.volumeTexture = (counts, samples) => {
  const texture = new THREE.DataTexture3D(samples, counts[0], counts[1], counts[2]);
  texture.format = THREE.RGBAFormat;
  texture.type = THREE.UnsignedByteType;
  texture.minFilter = texture.magFilter = THREE.LinearFilter;
  texture.unpackAlignment = 4;
  texture.needsUpdate = true;
  return texture;
};
