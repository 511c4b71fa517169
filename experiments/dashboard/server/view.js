// The big view: plate, numbers and curves of the live table, for a projector and for a phone.
addEventListener("DOMContentLoaded", () => {
  "use strict";
  const EVERY_MS = 100, CAMERA_MS = 500, LATER_MS = 1000;
  const here = location.pathname.replace(/\/view\/*$/, "");
  const Y = "#e8590c", GREEN = "#00b39b";
  let ink, pale, X;
  const dress = () => [ink, pale, X] = document.documentElement.dataset.looks === "dark"
    ? ["#fff", "#495057", "#b197fc"] : ["#000", "#ced4da", "#7048e8"];
  const at = (id) => document.getElementById(id);
  const write = (id, text) => { if (at(id).textContent !== text) at(id).textContent = text; };

  // A canvas as sharp as the screen; its size in CSS pixels.
  const clear = (canvas) => {
    const { width, height } = canvas.getBoundingClientRect(), sharp = devicePixelRatio || 1;
    canvas.width = width * sharp;
    canvas.height = height * sharp;
    const pen = canvas.getContext("2d");
    pen.scale(sharp, sharp);
    return [pen, width, height];
  };
  const line = (pen, points, colour, width) => {
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.beginPath();
    points.forEach(([x, y], i) => i ? pen.lineTo(x, y) : pen.moveTo(x, y));
    pen.stroke();
  };
  const disc = (pen, [x, y], radius, fill, edge) => {
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    Object.assign(pen, { fillStyle: fill, strokeStyle: edge, lineWidth: 5 });
    pen.fill();
    pen.stroke();
  };

  const drawPlate = (now) => {
    const [pen, width, height] = clear(at("plate")), size = Math.min(width, height) - 8;
    const scale = size / now.side_m;
    const px = ([x, y]) => [width / 2 + scale * x, height / 2 - scale * y];
    const half = now.side_m / 2;
    for (let cm = -Math.floor(50 * now.side_m / 5) * 5; cm <= 50 * now.side_m; cm += 5) {
      line(pen, [px([cm / 100, -half]), px([cm / 100, half])], pale, 1.5);
      line(pen, [px([-half, cm / 100]), px([half, cm / 100])], pale, 1.5);
    }
    pen.fillStyle = ink;
    pen.font = "700 16px system-ui, sans-serif";
    for (let cm = -5 * Math.floor(10 * now.side_m); cm <= 50 * now.side_m; cm += 5) {
      const [x] = px([cm / 100, 0]), [, y] = px([0, cm / 100]), [left, bottom] = px([-half, -half]);
      pen.fillText(`${cm}`, x + 4, bottom - 8);
      if (cm > -50 * now.side_m + 3) pen.fillText(`${cm}`, left + 8, y - 5);
    }
    const [, top] = px([0, half]), [right, low] = px([half, -half]);
    pen.textAlign = "right";
    pen.fillText("x [cm], 5 cm a square", right - 8, low - 26);
    pen.textAlign = "left";
    pen.fillText("y [cm]", px([-half, 0])[0] + 8, top + 22);
    pen.strokeStyle = ink;
    pen.lineWidth = 6;
    pen.strokeRect(...px([-half, half]), size, size);
    const [a, b] = now.target_m, reach = 1.6 * now.radius_m;  // beyond the ball that lies on it
    line(pen, [px([a - reach, b]), px([a + reach, b])], GREEN, 6);
    line(pen, [px([a, b - reach]), px([a, b + reach])], GREEN, 6);
    const { x_m: x, y_m: y } = now.curve, newest = x.length - 40;
    line(pen, x.map((v, i) => [v, y[i]]).filter(([a, b], i) => a !== null && b !== null && i > newest)
      .map(px), ink, 3);
    if (now.ball_m) disc(pen, px(now.ball_m), scale * now.radius_m, Y, ink);
  };

  const drawCurve = ({ curve, side_m }) => {
    const [pen, width, height] = clear(at("curve")), { t_s: t, x_m: x, y_m: y } = curve;
    const left = 56, seen = [...x, ...y].filter((v) => v !== null).map(Math.abs);
    const most = Math.min(side_m / 2, Math.max(0.02, 1.1 * Math.max(0, ...seen)));
    const bottom = height - 20;  // the times below
    const py = (v) => bottom / 2 - (bottom / 2 - 22) * v / most;  // the names above the lines
    pen.fillStyle = ink;
    pen.font = "700 16px system-ui, sans-serif";
    for (const v of [-most, 0, most]) {
      line(pen, [[left, py(v)], [width, py(v)]], pale, 1.5);
      pen.fillText(`${(100 * v).toFixed(1)}`, 0, py(v) + 6);
    }
    if (t.length < 2) return;
    const span = Math.max(t[t.length - 1] - t[0], 1e-3);
    const px = (s) => left + (width - left - 4) * (s - t[0]) / span;
    const now = t[t.length - 1], step = span > 8 ? 5 : 1;
    for (let back = 0; back <= span; back += step) {
      const at_px = px(now - back);
      line(pen, [[at_px, 22], [at_px, bottom]], pale, 1.5);
      pen.textAlign = back ? "center" : "right";
      if (!back || at_px > left + 24) pen.fillText(back ? `-${back} s` : "now", at_px, height - 3);
    }
    pen.textAlign = "left";
    for (const [values, colour, name, row] of [[x, X, "x [cm]", 0], [y, Y, "y [cm]", 1]]) {
      line(pen, t.map((s, i) => [s, values[i]]).filter(([, v]) => v !== null)
        .map(([s, v]) => [px(s), py(v)]), colour, 3.5);
      pen.fillStyle = colour;
      pen.fillText(name, left + 8 + 70 * row, 16);
    }
  };

  const show = (now) => {
    const [x, y] = now.ball_m || [NaN, NaN], [a, b] = now.target_m;
    write("off", now.ball_m ? (100 * Math.hypot(x - a, y - b)).toFixed(1) : "-");
    write("rms", now.rms_m === null ? "-" : (100 * now.rms_m).toFixed(2));
    write("time", now.t_s === null ? "-" : `${now.t_s.toFixed(0)} of ${now.duration_s.toFixed(0)}`);
    write("run", [now.title, now.run].filter(Boolean).join(": "));
    write("ask", now.ask && `Please ${now.ask}`);
    dress();
    drawPlate(now);
    drawCurve(now);
  };
  const again = async (what, every_ms) => {
    let next_ms = every_ms;
    try {
      if (!document.hidden) await what();
    } catch {
      next_ms = LATER_MS;  // the bar says that the program is gone
    }
    setTimeout(() => again(what, every_ms), next_ms);
  };
  const get = async (part) => {
    const answer = await fetch(`${here}/${part}`, { cache: "no-store" });
    if (!answer.ok) throw new Error(answer.statusText);
    return answer;
  };
  again(async () => show(await (await get("live")).json()), EVERY_MS);
  again(async () => {
    const image = await (await get("camera")).blob(), old = at("camera").src;
    at("camera").hidden = image.size === 0;
    at("camera").src = image.size ? URL.createObjectURL(image) : "";
    if (old) URL.revokeObjectURL(old);
  }, CAMERA_MS);
});
