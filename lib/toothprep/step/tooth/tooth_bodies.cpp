#include "toothprep/step/tooth/tooth_bodies.h"

#include <algorithm>
#include <array>
#include <set>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/extended_labels.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {
namespace {

constexpr int kAirLayers = 2;  // voxels of air that are of the nearest body

// The number of the only body in a brick, or -1.
int only_body(const std::uint8_t* body) {
  int only = 0;
  for (int v = 0; v < kBrickVoxels; ++v) {
    if (body[v] == 0 || body[v] == only) continue;
    if (only != 0) return -1;
    only = body[v];
  }
  return only;
}

// Bricks with one body as uniform ones.
LabelGrid without_lone_bricks(const LabelGrid& of, std::size_t bodies) {
  LabelGrid tidy = make_body_grid(of, bodies);
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    const int only = of.is_uniform(b) ? of.uniform_value(b) : only_body(of.brick(b));
    if (only < 0)
      tidy.set_brick(b, of.brick(b));
    else if (only > 0)
      tidy.set_uniform(b, static_cast<std::uint8_t>(only));
  }
  return tidy;
}

}  // namespace

std::size_t ToothBodies::worked() const {
  const auto found = std::find_if(list.begin(), list.end(),
                                  [](const Body& b) { return b.kind == BodyKind::kTooth; });
  return static_cast<std::size_t>(found - list.begin());
}

void check_bodies(const std::vector<Body>& list) {
  if (list.empty() || list.size() > kMostBodies)
    throw Error("a list of bodies has 1 to 64 of them, not " + std::to_string(list.size()));
  std::set<std::string> names;
  for (const Body& body : list) {
    const bool plain = std::all_of(body.name.begin(), body.name.end(), [](char c) {
      return c > ' ' && c <= '~' && c != ',' && c != '"' && c != ':' && c != '=' && c != '.';
    });
    if (body.name.empty() || body.name.size() > 40 || !plain)
      throw Error("body '" + body.name +
                  "': a name has 1 to 40 printable ASCII characters without blanks , : = . \"");
    if (!names.insert(body.name).second) throw Error("two bodies have the name " + body.name);
  }
  if (std::count_if(list.begin(), list.end(),
                    [](const Body& b) { return b.kind == BodyKind::kTooth; }) != 1)
    throw Error("of several bodies exactly one is the tooth that is prepared");
}

std::string bodies_text(const std::vector<Body>& list) {
  std::string text;
  for (const Body& body : list)
    text += (text.empty() ? "" : ",") + body.name + ":" +
            std::string(kBodyKindNames[static_cast<std::size_t>(body.kind)]);
  return text;
}

std::vector<Body> parse_bodies(const std::string& text) {
  std::vector<Body> list;
  std::string rest = text + ",";
  for (std::size_t end = 0; (end = rest.find(',')) != std::string::npos; rest.erase(0, end + 1)) {
    const std::string entry = rest.substr(0, end);
    const std::size_t colon = entry.find(':');
    const auto kind =
        std::find(kBodyKindNames.begin(), kBodyKindNames.end(),
                  colon == std::string::npos ? std::string() : entry.substr(colon + 1));
    if (kind == kBodyKindNames.end())
      throw Error("'" + entry + "' is not NAME:KIND with the kind tooth, neighbour or gum");
    list.push_back({entry.substr(0, colon), static_cast<BodyKind>(kind - kBodyKindNames.begin())});
  }
  check_bodies(list);
  return list;
}

LabelGrid make_body_grid(const LabelGrid& like, std::size_t bodies) {
  std::vector<std::uint8_t> numbers;
  for (std::size_t n = 1; n <= bodies; ++n) numbers.push_back(static_cast<std::uint8_t>(n));
  return LabelGrid(like.first_brick(), like.brick_counts(), 0, numbers);
}

void set_bodies(LayeredTooth& tooth, std::vector<Body> list, LabelGrid of) {
  check_bodies(list);
  std::array<std::uint8_t, kBrickVoxels> values;
  LabelGrid solid_only = make_body_grid(tooth.tissue, list.size());
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    const std::uint8_t *body = of.brick(b), *tissue = tooth.tissue.brick(b);
    if (tooth.tissue.is_uniform(b) && tissue[0] == 0) continue;  // most of an arch's box is air
    for (int v = 0; v < kBrickVoxels; ++v) {
      values[v] = tissue[v] == 0 ? std::uint8_t{0} : body[v];
      if (tissue[v] != 0 && (body[v] == 0 || body[v] > list.size()))
        throw Error("a voxel with a tissue is of body " + std::to_string(body[v]) + " of " +
                    std::to_string(list.size()));
    }
    solid_only.set_brick(b, values.data());
  }
  const LevelSet& solid = tooth.parts ? tooth.parts->intact : tooth.solid;
  const LabelGrid extended =
      extended_labels(solid_only, solid, static_cast<float>(tooth.band()), kAirLayers);
  tooth.bodies = ToothBodies{{}, without_lone_bricks(extended, list.size())};
  tooth.bodies->list = std::move(list);
}

std::vector<double> body_volumes_mm3(const LayeredTooth& tooth) {
  std::vector<double> fractions(tooth.bodies->list.size() + 1, 0.0);
  const LabelGrid& of = tooth.bodies->of;
  const double voxel = tooth.lattice.voxel;
  const auto inside = [voxel](float phi) {
    return std::clamp(0.5 - static_cast<double>(phi) / voxel, 0.0, 1.0);
  };
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    const std::uint8_t* body = of.brick(b);
    const float* phi = tooth.solid.brick(b);
    if (of.is_uniform(b) && tooth.solid.is_uniform(b)) {
      fractions[body[0]] += kBrickVoxels * inside(phi[0]);
      continue;
    }
    for (int v = 0; v < kBrickVoxels; ++v) fractions[body[v]] += inside(phi[v]);
  }
  fractions.erase(fractions.begin());
  for (double& f : fractions) f *= voxel * voxel * voxel;
  return fractions;
}

namespace {

Index3 voxel_of(const LabelGrid& grid, std::size_t brick, int offset) {
  return grid.brick_origin(brick) + Index3(offset >> 6, (offset >> 3) & 7, offset & 7);
}

// Whether one of the 26 voxels around is the body's.
bool touches_body(const LabelGrid& of, const Index3& at, std::uint8_t body) {
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j)
      for (int k = -1; k <= 1; ++k)
        if (of.value(at.x() + i, at.y() + j, at.z() + k) == body) return true;
  return false;
}

}  // namespace

// Where two bodies touch, the surface of the kept one lies between its voxels and those of the
// other. There the distance to the other's surface is the nearest known bound of its own: it puts
// the surface within the gap, where the band's end would draw it into the tooth.
LayeredTooth with_others_as_other(LayeredTooth tooth) {
  if (!tooth.bodies) return tooth;
  const LabelGrid& of = tooth.bodies->of;
  const auto kept = static_cast<std::uint8_t>(tooth.bodies->worked() + 1);
  std::array<std::uint8_t, kBrickVoxels> tissue;
  std::array<float, kBrickVoxels> level;
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    const std::uint8_t* body = of.brick(b);
    if (of.is_uniform(b) && (body[0] == kept || body[0] == 0)) continue;
    const auto is_other = [&](int v) { return body[v] != kept && body[v] != 0; };
    for (int v = 0; v < kBrickVoxels; ++v) {
      const std::uint8_t label = tooth.tissue.brick(b)[v];
      tissue[v] = label != 0 && is_other(v) ? static_cast<std::uint8_t>(Tissue::kOther) : label;
    }
    tooth.tissue.set_brick(b, tissue.data());
    std::array<bool, kBrickVoxels> touches{};
    for (int v = 0; v < kBrickVoxels; ++v)
      touches[v] = is_other(v) && touches_body(of, voxel_of(of, b, v), kept);
    for (PackedLevelSet& remains : tooth.remains) {
      const PackedBrick before = remains.brick(b);
      for (int v = 0; v < kBrickVoxels; ++v) {
        const float phi = before[v];
        level[v] = !is_other(v) ? phi : touches[v] ? std::abs(phi) : remains.background();
      }
      remains.set_brick(b, level.data());
    }
  }
  tooth.bodies.reset();
  if (tooth.parts) tooth.parts->tissues.reset();
  return tooth;
}

}  // namespace toothprep
