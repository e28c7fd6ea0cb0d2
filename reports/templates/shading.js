// Lines about color in the table of numbers; JavaScript hoists these functions, so that their order is free.
function light(c, wide) {
  if (!c) return [];
  const spread = (label, e) => line([cell(label), figure(short(e && e.rms)), cell("", { span: 2 }), figure(short(e && e.p99)), figure(short(e && e.max))]);
  const beyond = `${short(100 * c.above_step)} % of the pixels are off by more than 1/255; mean ${short(c.mean)}`;
  const lines = [spread("radiance error", c), spread("radiance error where both show the same triangle", c.away_from_edges), wide("", beyond)];
  if (c.flip !== null) lines.push(wide("looks different", `FLIP ${short(c.flip)}, SSIM ${c.ssim === null ? "–" : c.ssim.toPrecision(5)}`));
  return lines;
}
if (data.eye) Plotly.newPlot(get("plot-eye"), data.eye.data, data.eye.layout, { ...config, displayModeBar: false });
