// GLSL leaves the accuracy of some functions to the driver (Mesa's asin is off by 4e-4). The
// functions here are accurate to a few units in the last place of float32, and equal on all
// devices.

const float PI = 3.14159265358979;

vec3 unit(vec3 v) {
    precise vec3 direction = v / sqrt(dot(v, v));
    return direction;
}

// Replace subnormal numbers by zero: a device may keep them or flush them.
vec3 flushed(vec3 v) {
    return mix(v, vec3(0.0), lessThan(abs(v), vec3(1.1754944e-38)));
}

// Angle of the point (x, y) from the x axis, -PI to PI; 0 at the origin. Polynomial: Moshier,
// Cephes, atanf.
float angle_of(float x, float y) {
    float longer = max(abs(x), abs(y));
    if (longer == 0.0) return 0.0;
    precise float slope = min(abs(x), abs(y)) / longer;
    bool steep = slope > 0.414213562;  // tan(PI / 8)
    precise float t = steep ? (slope - 1.0) / (slope + 1.0) : slope;
    precise float z = t * t;
    precise float series = ((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z;
    precise float angle = (series - 3.33329491539e-1) * z * t + t + (steep ? PI / 4.0 : 0.0);
    if (abs(y) > abs(x)) angle = PI / 2.0 - angle;
    if (x < 0.0) angle = PI - angle;
    return y < 0.0 ? -angle : angle;
}

// A cosine to a power above 0; 0 if the cosine is not positive, and at most 1, because rounding may
// make cosines larger than one. The logarithm is ln m = 2 atanh((m - 1) / (m + 1)), which is
// accurate near m = 1, where highlights are. Powers below 2^-100 are 0: a software renderer kept
// subnormal numbers in one picture and flushed them in the next, so that their sums differed.
float power(float cosine, float exponent) {
    if (!(cosine > 0.0)) return 0.0;
    if (cosine >= 1.0) return 1.0;
    int scale;
    precise float m = frexp(cosine, scale);
    if (m < 0.70710678) {
        m *= 2.0;
        scale -= 1;
    }
    precise float s = (m - 1.0) / (m + 1.0);
    precise float z = s * s;
    precise float series = 1.0 + z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z / 9.0)));
    precise float binary_logarithm = float(scale) + 2.88539008177793 * s * series;  // 2 / ln(2)
    precise float logarithm = exponent * binary_logarithm;
    return logarithm < -100.0 ? 0.0 : exp2(logarithm);
}
