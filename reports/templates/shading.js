// Lines about color in the table of numbers; function declarations are known before they are reached.
function light(c) {
  if (!c) return "";
  const line = (label, e) => `<tr><td>${label}</td><td class="n">${short(e && e.rms)}</td><td colspan="2"></td><td class="n">${short(e && e.p99)}</td><td class="n">${short(e && e.max)}</td></tr>`;
  const beyond = `${short(100 * c.above_step)} % of the pixels are off by more than 1/255; mean ${short(c.mean)}`;
  const looks = c.flip === null ? "" : `<tr><td>looks different</td><td colspan="5">FLIP ${short(c.flip)}, SSIM ${c.ssim === null ? "–" : c.ssim.toPrecision(5)}</td></tr>`;
  return `${line("radiance error", c)}${line("the same, where both show one triangle", c.away_from_edges)}
    <tr><td></td><td colspan="5">${beyond}</td></tr>${looks}`;
}
if (data.eye) Plotly.newPlot(get("plot-eye"), data.eye.data, data.eye.layout, { ...config, displayModeBar: false });
