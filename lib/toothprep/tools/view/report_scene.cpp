#include "toothprep/tools/view/report_scene.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <unordered_map>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/score_report/markup.h"
#include "toothprep/tools/view/page_assets.h"
#include "toothprep/tools/view/scene_facts.h"
#include "toothprep/tools/view/wire.h"

namespace toothprep {
namespace {

constexpr double kStep = 0.005;                // mm: finer than a surface is known
constexpr std::size_t kLargestMesh = 1200000;  // bytes packed: 1.6 MB as text, each
constexpr int kLevel = 6;                      // of zlib: 9 takes four times as long for 0.6 % less
constexpr double kFirstCell = 0.1;             // mm, doubled by steps of a quarter

std::string deflated(const std::string& bytes) {
  uLongf size = compressBound(bytes.size());
  std::string packed(size, 0);
  if (compress2(reinterpret_cast<Bytef*>(packed.data()), &size,
                reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(), kLevel) != Z_OK)
    throw Error("report: the scene can't be packed");
  packed.resize(size);
  return packed;
}

void append_difference(std::int64_t difference, std::string& bytes) {
  auto zigzag = static_cast<std::uint64_t>(difference < 0 ? -2 * difference - 1 : 2 * difference);
  for (; zigzag > 127; zigzag >>= 7) bytes += static_cast<char>(128 | (zigzag & 127));
  bytes += static_cast<char>(zigzag);
}

Box bounds_of(const TriangleMesh& mesh) {
  Box box{Vec3::Constant(1e30), Vec3::Constant(-1e30)};
  for (const auto& v : mesh.vertices)
    box = {box.min.cwiseMin(v.cast<double>()), box.max.cwiseMax(v.cast<double>())};
  return box;
}

// Packed, coarser if need be.
std::string packed_small(TriangleMesh mesh, std::vector<float> deviation) {
  std::string packed = packed_mesh(mesh, deviation);
  for (double cell = kFirstCell; packed.size() > kLargestMesh; cell *= 1.25) {
    make_coarser(mesh, deviation, cell);
    packed = packed_mesh(mesh, deviation);
  }
  return packed;
}

std::string data_block(const char* id, const std::string& content) {
  return std::string("<script type=\"text/plain\" id=\"") + id + "\">" + content + "</script>\n";
}

std::string from_hex(const std::string& digits) {
  std::string bytes;
  for (std::size_t i = 0; i + 1 < digits.size(); i += 2)
    bytes += static_cast<char>(std::stoi(digits.substr(i, 2), nullptr, 16));
  return bytes;
}

std::string asset(const char* path) {
  const auto found = page_asset(path);
  if (!found) throw Error(std::string("report: the program lacks ") + path);
  return found->body;
}

}  // namespace

std::string packed_mesh(const TriangleMesh& mesh, const std::vector<float>& deviation) {
  const Vec3 origin = bounds_of(mesh).min;
  std::string bytes;
  for (int i = 0; i < 3; ++i) append_bytes(static_cast<float>(origin[i]), bytes);
  append_bytes(static_cast<float>(kStep), bytes);
  append_bytes(static_cast<std::uint32_t>(mesh.vertices.size()), bytes);
  append_bytes(static_cast<std::uint32_t>(mesh.triangles.size()), bytes);
  for (int i = 0; i < 3; ++i) {
    std::int64_t last = 0;
    for (const auto& v : mesh.vertices) {
      const std::int64_t at = std::lround((static_cast<double>(v[i]) - origin[i]) / kStep);
      append_difference(at - last, bytes);
      last = at;
    }
  }
  std::int64_t last = 0;
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t v : triangle) {
      append_difference(static_cast<std::int64_t>(v) - last, bytes);
      last = v;
    }
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
    append_bytes(vertex_code(mesh.tissue.empty() ? 0 : mesh.tissue[v],
                             deviation.empty() ? NAN : deviation[v]),
                 bytes);
  return deflated(bytes);
}

void make_coarser(TriangleMesh& mesh, std::vector<float>& deviation, double cell) {
  TriangleMesh coarse;
  std::vector<float> kept;
  std::unordered_map<std::uint64_t, std::uint32_t> of_cell;
  std::vector<std::uint32_t> now(mesh.vertices.size());
  const Vec3 origin = bounds_of(mesh).min;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    std::uint64_t key = 0;
    for (int i = 0; i < 3; ++i)
      key = key << 21 | static_cast<std::uint64_t>(
                            (static_cast<double>(mesh.vertices[v][i]) - origin[i]) / cell);
    const auto [at, fresh] =
        of_cell.try_emplace(key, static_cast<std::uint32_t>(coarse.vertices.size()));
    now[v] = at->second;
    if (!fresh) continue;
    coarse.vertices.push_back(mesh.vertices[v]);
    if (!mesh.tissue.empty()) coarse.tissue.push_back(mesh.tissue[v]);
    if (!deviation.empty()) kept.push_back(deviation[v]);
  }
  for (const auto& t : mesh.triangles) {
    const std::array<std::uint32_t, 3> u = {now[t[0]], now[t[1]], now[t[2]]};
    if (u[0] != u[1] && u[1] != u[2] && u[2] != u[0]) coarse.triangles.push_back(u);
  }
  mesh = std::move(coarse);
  deviation = std::move(kept);
}

ScenePart scene_part(const ReportScene& scene) {
  SceneFacts facts;
  facts.kind = SceneKind::kSurfaces;
  facts.layers = {"before", "after"};
  const Box a = bounds_of(scene.before), b = bounds_of(scene.after);
  facts.bounds = {a.min.cwiseMin(b.min), a.max.cwiseMax(b.max)};
  facts.axes = scene.axes;
  facts.deviation = !scene.deviation.empty();

  std::string script = "//<![CDATA[\n";
  for (const char* path :
       {"three.js", "orbit.js", "data.js", "surface.js", "stereo.js", "scene.js", "report.js"})
    script += asset(path) + "\n;\n";
  script += "//]]>";
  Sha256 hash;
  hash.update(script.data(), script.size());

  ScenePart part;
  part.policy = "'sha256-" + base64(from_hex(hash.hex())) + "'";
  part.markup = "<section id=\"scene\" hidden=\"hidden\"></section>\n" +
                data_block("scene-facts", scene_json(facts)) +
                data_block("scene-before", base64(packed_small(scene.before, {}))) +
                data_block("scene-after", base64(packed_small(scene.after, scene.deviation))) +
                "<script>" + script + "</script>\n";
  return part;
}

}  // namespace toothprep
