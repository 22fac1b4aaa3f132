// The mesh to turn about: drag, wheel or pinch, arrow keys. Without WebGL 2 the pictures below tell the same.
(() => {
  const box = document.getElementById("viewer"), text = document.getElementById("shape");
  if (!box || !text) return;
  const canvas = box.querySelector("canvas"), gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
  if (!gl) { box.closest("figure").remove(); return; }
  const shape = JSON.parse(text.textContent);
  const bytes = (s) => Uint8Array.from(atob(s), (c) => c.charCodeAt(0));
  const places = new Float32Array(bytes(shape.places).buffer), faces = new Uint32Array(bytes(shape.faces).buffer);
  const compile = (kind, source) => { const s = gl.createShader(kind); gl.shaderSource(s, source); gl.compileShader(s); return s; };
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl.VERTEX_SHADER, `#version 300 es
    in vec3 place; in vec3 paint; uniform mat3 turn; uniform vec2 scale; out vec3 colour; out vec3 spot;
    void main() { vec3 p = turn * place; spot = p; colour = paint; gl_Position = vec4(p.xy * scale, -0.3 * p.z, 1.0); }`));
  gl.attachShader(program, compile(gl.FRAGMENT_SHADER, `#version 300 es
    precision highp float; in vec3 colour; in vec3 spot; out vec4 pixel;
    void main() { vec3 n = normalize(cross(dFdx(spot), dFdy(spot)));
      pixel = vec4(colour * (0.45 + 0.6 * max(dot(n, normalize(vec3(-0.35, 0.55, 0.75))), 0.0)), 1.0); }`));
  gl.linkProgram(program); gl.useProgram(program); gl.enable(gl.DEPTH_TEST);
  const attribute = (name, data, kind, whole) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    const at = gl.getAttribLocation(program, name); gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, 3, kind, whole, 0, 0);
  };
  attribute("place", places, gl.FLOAT, false);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  let azimuth = -1.01, elevation = 0.49, zoom = 1.0, asked = false;
  const draw = () => {
    asked = false;
    const w = canvas.clientWidth * devicePixelRatio, h = canvas.clientHeight * devicePixelRatio;
    if (canvas.width !== Math.round(w)) canvas.width = w;
    if (canvas.height !== Math.round(h)) canvas.height = h;
    gl.viewport(0, 0, w, h); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const ca = Math.cos(azimuth), sa = Math.sin(azimuth), ce = Math.cos(elevation), se = Math.sin(elevation);
    gl.uniformMatrix3fv(gl.getUniformLocation(program, "turn"), false,
      [-sa, -se * ca, ce * ca, ca, -se * sa, ce * sa, 0, ce, se]);
    const fit = 0.92 * zoom * Math.min(w, h); gl.uniform2f(gl.getUniformLocation(program, "scale"), fit / w, fit / h);
    gl.drawElements(gl.TRIANGLES, faces.length, gl.UNSIGNED_INT, 0);
  };
  const soon = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };
  const modes = box.parentElement.querySelector(".modes");
  const show = (button) => {
    modes.querySelectorAll("button").forEach((b) => b.setAttribute("aria-pressed", b === button));
    attribute("paint", bytes(shape.paints[button.dataset.paint]), gl.UNSIGNED_BYTE, true); draw();
    box.dataset.drawn = "yes";
  };
  modes.addEventListener("click", (e) => { if (e.target.dataset.paint) show(e.target); });
  const held = new Map();
  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); held.set(e.pointerId, e); });
  canvas.addEventListener("pointermove", (e) => {
    const before = held.get(e.pointerId); if (!before) return;
    if (held.size === 1) {
      azimuth -= 0.008 * (e.clientX - before.clientX);
      elevation = Math.max(-1.5, Math.min(1.5, elevation + 0.008 * (e.clientY - before.clientY)));
    } else {
      const gap = () => { const [p, q] = [...held.values()]; return Math.hypot(p.clientX - q.clientX, p.clientY - q.clientY); };
      const old = gap(); held.set(e.pointerId, e); zoom = Math.max(0.3, Math.min(8, zoom * gap() / Math.max(old, 1)));
    }
    held.set(e.pointerId, e); soon();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => held.delete(e.pointerId));
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom = Math.max(0.3, Math.min(8, zoom * Math.exp(-0.001 * e.deltaY))); soon(); }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    const step = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
    if (step) { e.preventDefault(); azimuth += step[0]; elevation = Math.max(-1.5, Math.min(1.5, elevation + step[1])); soon(); }
  });
  addEventListener("resize", soon);
  show(modes.querySelector("button"));
})();
