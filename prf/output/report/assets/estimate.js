"use strict";
// Probabilities with their Monte Carlo error, as prf/results/estimate.py and prf/results/convergence.py have them.
Prf.estimate = (() => {
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  function variance(values) {
    const middle = mean(values);
    return values.reduce((sum, value) => sum + (value - middle) ** 2, 0) / (values.length - 1);
  }
  // Each chain cut into pieces of one length; the draws that are over are left out of the middle.
  function pieces(chains, n) {
    const length = Math.floor(chains[0].length / n),
      rest = chains[0].length - length,
      start = (i) => (n === 1 ? 0 : Math.floor((i * rest) / (n - 1)));
    return Array.from({ length: n }, (_, i) => chains.map((chain) => chain.slice(start(i), start(i) + length))).flat();
  }
  const varianceOfMean = (parts) => variance(parts.map(mean)) / parts.length;

  function effectiveSize(chains) {
    const halves = pieces(chains, 2),
      means = halves.map(mean),
      n = halves[0].length,
      covariance = (lag) =>
        mean(
          halves.map((half, c) => {
            let sum = 0;
            for (let i = lag; i < n; i++) sum += (half[i] - means[c]) * (half[i - lag] - means[c]);
            return sum / n;
          }),
        );
    const atOnce = covariance(0),
      total = atOnce + variance(means),
      correlation = (lag) => (lag ? 1 - ((atOnce * n) / (n - 1) - covariance(lag)) / total : 1);
    if (!(total > 0)) return NaN;
    // Geyer's initial monotone sequence.
    const last = Math.max(Math.floor((n - 3) / 2), 0);
    let time = -1,
      least = Infinity;
    for (let k = 0; ; k++) {
      const even = correlation(2 * k),
        pair = even + correlation(2 * k + 1);
      if ((k && pair <= 0) || k === last) {
        time += even > 0 || pair >= 0 ? even : 0;
        break;
      }
      least = Math.min(least, pair);
      time += 2 * least;
    }
    const size = halves.length * n;
    return size / Math.max(time, 1 / Math.log10(size));
  }
  function splitRhat(chains) {
    const parts = pieces(chains, chains.length > 1 ? 2 : 4),
      n = parts[0].length,
      rhat = Math.sqrt(variance(parts.map(mean)) / mean(parts.map(variance)) + (n - 1) / n);
    return Number.isNaN(rhat) ? 1 : rhat;
  }
  // Quantile 0.975 of Student's t: Abramowitz and Stegun 26.7.5, right to 1e-4 from seven degrees of freedom on.
  function studentQuantile(degrees) {
    // Of few chains the series below is too coarse.
    const few = [0, 12.7062047, 4.30265273, 3.18244631, 2.77644511, 2.57058184];
    if (degrees < few.length && Number.isInteger(degrees)) return few[degrees];
    const z = 1.959963985,
      terms = [
        (z ** 3 + z) / 4,
        (5 * z ** 5 + 16 * z ** 3 + 3 * z) / 96,
        (3 * z ** 7 + 19 * z ** 5 + 17 * z ** 3 - 15 * z) / 384,
        (79 * z ** 9 + 776 * z ** 7 + 1482 * z ** 5 - 1920 * z ** 3 - 945 * z) / 92160,
      ];
    return terms.reduce((sum, term, i) => sum + term / degrees ** (i + 1), z);
  }
  function wilson(share, size, degrees) {
    const shrink = studentQuantile(degrees) ** 2 / size,
      centre = (share + 0.5 * shrink) / (1 + shrink),
      half = Math.sqrt(shrink * (share * (1 - share) + 0.25 * shrink)) / (1 + shrink);
    return [Math.max(centre - half, 0), Math.min(centre + half, 1)];
  }

  // values: 0 or 1 of each draw in the order of chains; starts: where each chain begins, and the end; smallestEss: of the
  // run; nearEss: what draws that are all equal count for.
  return (values, starts, smallestEss, nearEss) => {
    const n = Math.min(...starts.slice(1).map((end, i) => end - starts[i])),
      chains = starts.slice(1).map((end) => Array.from(values.subarray(end - n, end))),
      p = mean(chains.flat());
    if (n < 8) return { p, low: 0, high: 1, ess: NaN, rhat: NaN };
    const rhat = splitRhat(chains),
      bound = 1 - 0.05 ** (1 / nearEss);
    if (p === 0) return { p, low: 0, high: bound, ess: nearEss, rhat };
    if (p === 1) return { p, low: 1 - bound, high: 1, ess: nearEss, rhat };
    const ess = effectiveSize(chains),
      parts = pieces(chains, Math.max(2, Math.ceil(8 / chains.length))),
      spread = p * (1 - p),
      errors = [spread / ess, varianceOfMean(parts), chains.length > 1 ? varianceOfMean(chains) : 0],
      error = Math.max(...errors.filter((each) => !Number.isNaN(each))),
      own = Math.min(Math.max(spread / error, 1), chains.length * n),
      size = 1 / (1 / own + 1 / (4 * smallestEss)), // MOST_WORTH and APART of prf.results.estimate
      degrees = chains.length > 1 && rhat > 1.1 ? chains.length - 1 : Math.max(parts.length - 1, size / 20),
      [low, high] = wilson(p, size, degrees);
    return { p, low: p * size < 3 ? 0 : low, high: (1 - p) * size < 3 ? 1 : high, ess, rhat };
  };
})();
