// Hogel renderer in one file: read_case CASE OUT draws the passes of CASE/cameras.json with a depth
// buffer of doubles, and writes OUT/hogel_{i}x{j}.ppm with triangle numbers plus one.
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

// Minimal JSON reader: numbers, strings, lists and objects.
struct Json {
    double number = 0;
    std::string text;
    std::vector<Json> list;
    std::map<std::string, Json> object;
    const Json& operator[](const std::string& name) const { return object.at(name); }
};

static void blank(const char*& p) { while (std::isspace((unsigned char)*p) || *p == ',' || *p == ':') ++p; }

static Json parse(const char*& p) {
    Json found;
    blank(p);
    if (*p == '{') {
        for (++p, blank(p); *p != '}'; blank(p)) { std::string name = parse(p).text; found.object[name] = parse(p); }
        ++p;
    } else if (*p == '[') {
        for (++p, blank(p); *p != ']'; blank(p)) found.list.push_back(parse(p));
        ++p;
    } else if (*p == '"') {
        for (++p; *p != '"'; ++p) { if (*p == '\\') ++p; found.text += *p; }
        ++p;
    } else if (std::isalpha((unsigned char)*p)) {
        while (std::isalpha((unsigned char)*p)) found.text += *p++;
    } else {
        char* end;
        found.number = std::strtod(p, &end);
        p = end;
    }
    return found;
}

static Json read(const std::string& path) {
    std::ifstream file(path);
    std::stringstream all;
    all << file.rdbuf();
    std::string text = all.str();
    const char* p = text.c_str();
    return parse(p);
}

using Corner = std::array<double, 4>;  // clip x, y, w, and one: homogeneous coordinates on the film

int main(int argc, char** argv) {
    if (argc != 3) return std::cerr << "usage: read_case CASE OUT\n", 2;
    std::string folder = argv[1], out = argv[2];
    Json asked = read(folder + "/case.json"), cameras = read(folder + "/cameras.json");
    if (asked["asked"].text != "triangle-id") {
        std::ofstream(out + "/unsupported") << "only numbers of triangles\n";
        return 0;
    }
    std::vector<std::array<double, 3>> vertices;
    std::vector<std::array<int, 3>> faces;
    std::ifstream mesh(folder + "/scene.obj");
    for (std::string line; std::getline(mesh, line);) {
        std::istringstream words(line);
        std::string kind, corner;
        words >> kind;
        if (kind == "v") {
            // Avoid >>, which refuses numbers as small as 1e-300 in some libraries.
            std::array<double, 3> v;
            for (double& x : v) { words >> corner; x = std::strtod(corner.c_str(), nullptr); }
            vertices.push_back(v);
        } else if (kind == "f") {
            std::array<int, 3> f;
            for (int& i : f) { words >> corner; i = std::atoi(corner.c_str()) - 1; }
            faces.push_back(f);
        }
    }
    // Two cameras offset from the plate cannot show the whole true frustum. Decline triangles
    // nearer to the plate than the offset, and films that are wider than the scene at the distance
    // of the offset.
    for (const Json& aperture : cameras["apertures"].list)
        for (const Json& pass : aperture["passes"].list) {
            const auto &center = aperture["center"].list, &half = pass["half_extent"].list;
            double near = pass["near"].number, extent = 0;
            bool claimed = true;
            for (const auto& v : vertices)
                for (int axis : {0, 1}) extent = std::max(extent, std::abs(v[axis] - center[axis].number));
            for (const auto& f : faces) {
                double height = 0;
                for (int i : f) height = std::max(height, std::abs(vertices[i][2]));
                claimed = claimed && !(0 < height && height < near);
            }
            claimed = claimed && std::max(half[0].number, half[1].number) * near <= extent;
            if (claimed || asked["near"].text != "null") continue;
            std::ofstream(out + "/unsupported") << "surfaces nearer to the plate than the cameras' step\n";
            return 0;
        }
    int width = (int)asked["resolution"].list[0].number, height = (int)asked["resolution"].list[1].number;
    for (const Json& aperture : cameras["apertures"].list) {
        std::vector<int> shown(width * height, 0);
        for (const Json& pass : aperture["passes"].list) {
            double near = pass["near"].number, far = pass["far"].number;
            bool farthest = pass["wins"].text == "farthest";
            std::vector<double> depth(width * height, farthest ? -1e300 : 1e300);
            for (int t = 0; t < (int)faces.size(); ++t) {
                std::array<std::array<double, 3>, 3> q;  // x, y, w of each corner
                for (int k = 0; k < 3; ++k)
                    for (int row : {0, 1, 3}) {
                        const auto& m = pass["clip_from_scene"].list[row].list;
                        const auto& v = vertices[faces[t][k]];
                        q[k][row == 3 ? 2 : row] = m[0].number * v[0] + m[1].number * v[1] + m[2].number * v[2] + m[3].number;
                    }
                // Edge functions in homogeneous coordinates need no clipping (Olano and Greer 1997).
                auto cross = [](const std::array<double, 3>& a, const std::array<double, 3>& b) {
                    return std::array<double, 3>{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
                };
                auto e0 = cross(q[1], q[2]), e1 = cross(q[2], q[0]), e2 = cross(q[0], q[1]);
                double volume = q[0][0] * e0[0] + q[0][1] * e0[1] + q[0][2] * e0[2];
                if (volume == 0) continue;
                for (int row = 0; row < height; ++row)
                    for (int column = 0; column < width; ++column) {
                        double u = (2.0 * column + 1) / width - 1, v = 1 - (2.0 * row + 1) / height;
                        double a = (e0[0] * u + e0[1] * v + e0[2]) / volume, b = (e1[0] * u + e1[1] * v + e1[2]) / volume;
                        double c = (e2[0] * u + e2[1] * v + e2[2]) / volume;
                        if (a < 0 || b < 0 || c < 0) continue;
                        double w = 1 / (a + b + c);  // w of the point that the pixel shows
                        int at = row * width + column;
                        if (!(w >= near && w <= far) || !(farthest ? w > depth[at] : w < depth[at])) continue;
                        depth[at] = w;
                        shown[at] = t + 1;
                    }
            }
        }
        int i = (int)aperture["aperture"].list[0].number, j = (int)aperture["aperture"].list[1].number;
        std::ofstream file(out + "/hogel_" + std::to_string(i) + "x" + std::to_string(j) + ".ppm", std::ios::binary);
        file << "P6\n" << width << " " << height << "\n255\n";
        for (int number : shown) file << (char)(number >> 16 & 255) << (char)(number >> 8 & 255) << (char)(number & 255);
    }
}
