'use strict';
// Triangles, dots and lines on a canvas, by WebGL.

const SOLID = [`
attribute vec3 at;
attribute vec3 normal;
attribute float kind;
uniform mat4 matrix;
uniform vec3 axes[3];
uniform vec3 colours[8];
varying vec3 paint;
varying vec3 facing;
varying float high;
void main() {
  gl_Position = matrix * vec4(at, 1.0);
  paint = colours[int(kind + 0.5)];
  facing = vec3(dot(axes[0], normal), dot(axes[1], normal), -dot(axes[2], normal));
  high = at.z;
}`, `
precision mediump float;
uniform float cut;
uniform float alpha;
uniform float capped;
varying vec3 paint;
varying vec3 facing;
varying highp float high;
void main() {
  if (high > cut) discard;
  vec3 n = normalize(facing);
  // The inside of a body that is cut open is seen where the cut goes through it.
  if (!gl_FrontFacing && capped > 0.5) {
    gl_FragColor = vec4(paint * 0.62 * alpha, alpha);
    return;
  }
  if (!gl_FrontFacing) n = -n;
  float light = 0.55 + 0.45 * max(dot(n, vec3(-0.36, 0.48, 0.8)), 0.0) + 0.1 * n.y;
  gl_FragColor = vec4(paint * light * alpha, alpha);
}`];

const DOTS = [`
attribute vec3 at;
attribute float size;
attribute float kind;
uniform mat4 matrix;
uniform vec3 away;
uniform vec3 colours[8];
uniform float scale;
uniform float fixedSize;
uniform float least;
varying vec3 paint;
varying float high;
void main() {
  gl_Position = matrix * vec4(at, 1.0);
  float across = size / 5.0;
  gl_PointSize = fixedSize > 0.0 ? fixedSize : max(across * scale / gl_Position.w, least);
  // A little nearer, so that the surface that it lies on does not cover it.
  vec4 nearer = matrix * vec4(at - away * (0.1 + 0.4 * across), 1.0);
  gl_Position.z = nearer.z / nearer.w * gl_Position.w;
  paint = colours[int(kind + 0.5)];
  high = at.z;
}`, `
precision mediump float;
uniform float cut;
uniform float shape;
uniform vec3 rim;
varying vec3 paint;
varying highp float high;
void main() {
  if (high > cut) discard;
  gl_FragColor = vec4(paint, 1.0);
  if (shape < 0.5) return;
  vec2 p = gl_PointCoord * 2.0 - 1.0;
  float r = length(p);
  if (r > 1.0) discard;
  if (shape < 1.5) return;
  // A mark: a disc with a rim and an exclamation mark.
  bool stroke = abs(p.x) < 0.12 && ((p.y > -0.55 && p.y < 0.12) || (p.y > 0.3 && p.y < 0.54));
  if (r > 0.84 || stroke) gl_FragColor = vec4(rim, 1.0);
}`];

class Painter {
  /** `null` where there is no WebGL. */
  static on(canvas) {
    // Preserved, so that the picture can be printed and saved at any time.
    const gl = canvas.getContext('webgl', { antialias: true, alpha: true, preserveDrawingBuffer: true });
    return gl ? new Painter(canvas, gl) : null;
  }

  constructor(canvas, gl) {
    Object.assign(this, { canvas, gl });
    this.solid = this.program(SOLID, ['at', 'normal', 'kind']);
    this.dots = this.program(DOTS, ['at', 'size', 'kind']);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  program([vertex, fragment], attributes) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    attributes.forEach((name, k) => gl.bindAttribLocation(program, k, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(`The graphics card does not take the drawing: ${gl.getProgramInfoLog(program) ?? 'it says nothing'}`);
    }
    const places = new Map();
    const uniform = (name) => {
      if (!places.has(name)) places.set(name, gl.getUniformLocation(program, name));
      return places.get(name);
    };
    return { program, uniform };
  }

  /** Triangles, dots or lines on the graphics card. */
  load(soup) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, soup.used, gl.STATIC_DRAW);
    return { buffer, count: soup.count };
  }

  unload(loaded) {
    this.gl.deleteBuffer(loaded.buffer);
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
  }

  draw(loaded, mode) {
    const { gl } = this;
    if (!loaded?.count) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, loaded.buffer);
    for (const k of [0, 1, 2]) gl.enableVertexAttribArray(k);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, STRIDE, 0);
    if (mode === gl.TRIANGLES) gl.vertexAttribPointer(1, 3, gl.BYTE, true, STRIDE, 12);
    else gl.vertexAttribPointer(1, 1, gl.BYTE, false, STRIDE, 12);
    gl.vertexAttribPointer(2, 1, gl.BYTE, false, STRIDE, 15);
    gl.drawArrays(mode, 0, loaded.count);
  }

  /**
   * One picture. `shown`: `{part, solids: [], dots: [], lines, marks, picked}`, each loaded or
   * nothing; `cut`: height above which nothing is, mm; `solid`: the part hides what is behind.
   */
  paint(camera, shown, cut, solid) {
    const { gl } = this;
    const ratio = this.canvas.width / Math.max(this.canvas.clientWidth, 1);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const colours = new Float32Array(KINDS.flatMap((name) => rgb(colour(name))));
    const axes = camera.axes;
    const open = Number.isFinite(cut);
    const use = ({ program, uniform }) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(uniform('matrix'), false, camera.matrix);
      gl.uniform3fv(uniform('colours[0]'), colours);
      gl.uniform1f(uniform('cut'), open ? cut : 1e9);
      return uniform;
    };

    const solidOf = use(this.solid);
    gl.uniform3fv(solidOf('axes[0]'), new Float32Array(axes.flat()));
    gl.uniform1f(solidOf('capped'), open ? 1 : 0);
    gl.uniform1f(solidOf('alpha'), 1);
    gl.disable(gl.BLEND);
    for (const body of shown.solids) this.draw(body, gl.TRIANGLES);
    if (solid) this.draw(shown.part, gl.TRIANGLES);

    const dotsOf = use(this.dots);
    gl.uniform3fv(dotsOf('away'), new Float32Array(axes[2]));
    gl.uniform3fv(dotsOf('rim'), new Float32Array(rgb(colour('paper'))));
    gl.uniform1f(dotsOf('scale'), (this.canvas.height / 2) * camera.lens[1]);
    gl.uniform1f(dotsOf('least'), 2 * ratio);
    gl.uniform1f(dotsOf('fixedSize'), 0);
    gl.uniform1f(dotsOf('shape'), 0);
    this.draw(shown.lines, gl.LINES);
    gl.uniform1f(dotsOf('shape'), 1);
    for (const dots of shown.dots) this.draw(dots, gl.POINTS);

    if (!solid) this.glass(shown.part, solidOf);

    gl.useProgram(this.dots.program);
    gl.uniform1f(dotsOf('shape'), 2);
    gl.uniform1f(dotsOf('fixedSize'), (shown.marks?.count > 60 ? 13 : 19) * ratio);
    gl.disable(gl.DEPTH_TEST);
    this.draw(shown.marks, gl.POINTS);
    gl.uniform1f(dotsOf('fixedSize'), 28 * ratio);
    this.draw(shown.picked, gl.POINTS);
    gl.enable(gl.DEPTH_TEST);
  }

  /** The nearest surface of a body, as of tinted glass: first how far, then what colour. */
  glass(body, uniform) {
    const { gl } = this;
    gl.useProgram(this.solid.program);
    gl.colorMask(false, false, false, false);
    this.draw(body, gl.TRIANGLES);
    gl.colorMask(true, true, true, true);
    gl.enable(gl.BLEND);
    gl.uniform1f(uniform('alpha'), 0.5);
    this.draw(body, gl.TRIANGLES);
    gl.disable(gl.BLEND);
  }
}

/** `#rrggbb` as three numbers up to 1. */
function rgb(hex) {
  return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255 || 0);
}
