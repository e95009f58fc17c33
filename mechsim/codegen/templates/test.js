// Checks the solver against the analytic solution, and times it.
"use strict";
const solver = require("./HEADER");
DATA
const s = solver.state();
const values = solver.KINDs.map(() => solver.KIND());
const at = (list, k) => list.slice(k * solver.drivers.length, (k + 1) * solver.drivers.length);
const solve = (k) => solver.solve(s, at(drivers, k), at(rates, k), at(accelerations, k));
let worst = solver.start(s) === solver.SOLVED ? 0 : Infinity;
for (let k = 0; k < COUNT; k++) {
  if (solve(k) !== solver.SOLVED) { worst = Infinity; break; }
  solver.solve_KINDs(s, values);
  for (let i = 0; i < COMPARED; i++) {
    ["position", "velocity", "acceleration"].forEach((quantity, e) => {
      for (let j = 0; j < 3; j++) {
        const expected = reference[(k * COMPARED + i) * 9 + 3 * e + j];
        const error = Math.abs(values[index[i]][quantity][j] - expected) / scales[e];
        if (!(error <= worst)) { worst = Number.isNaN(error) ? Infinity : error; }
      }
    });
  }
}
#if LIMITED
if (solver.solve(s, [@HIGH + 1], [0], [0]) === solver.SOLVED) { worst = Infinity; }
#endif
let us = 0;
for (const seconds of worst <= TOLERANCE ? [0.1, 0.1] : []) { // the first round is for node to compile the code
  const begin = process.hrtime.bigint();
  let solved = 0;
  for (; Number(process.hrtime.bigint() - begin) < 1e9 * seconds; solved += 2 * COUNT) {
    for (let k = 0; k < 2 * COUNT; k++) { solve(k < COUNT ? k : 2 * COUNT - 1 - k); }
  }
  us = Number(process.hrtime.bigint() - begin) / 1e3 / solved;
}
console.log(`NAME: largest relative error ${worst}, allowed TOLERANCE; ${us.toFixed(3)} us a configuration`);
process.exitCode = worst <= TOLERANCE ? 0 : 1;
