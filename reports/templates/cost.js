"use strict";
const figure = JSON.parse(document.getElementById("figure").textContent);
// A legend below a narrow plot takes a line for each entry.
if (innerWidth < 640) figure.layout.height += 260;
Plotly.newPlot("plot", figure.data, figure.layout, { responsive: true, displaylogo: false });
