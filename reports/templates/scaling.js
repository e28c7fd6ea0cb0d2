"use strict";
const figures = JSON.parse(document.getElementById("figures").textContent);
for (const [place, figure] of Object.entries(figures)) {
  Plotly.newPlot(place, figure.data, figure.layout, { responsive: true, displaylogo: false });
}
