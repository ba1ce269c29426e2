#include "body_options.h"

#include <algorithm>
#include <optional>
#include <set>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep::app {
namespace {

constexpr const char* kPrepared = "tooth";  // its name, unless one is given

struct NamedBody {
  std::string name;
  std::optional<BodyKind> kind;
};

// "37" or "36:tooth".
NamedBody parse_name(const std::string& text, const char* option) {
  const std::size_t colon = text.find(':');
  NamedBody body{text.substr(0, colon), {}};
  if (colon == std::string::npos) return body;
  const auto kind = std::find(kBodyKindNames.begin(), kBodyKindNames.end(), text.substr(colon + 1));
  if (kind == kBodyKindNames.end())
    throw CLI::ValidationError(option, "'" + text + "': the kind is tooth, neighbour or gum");
  body.kind = static_cast<BodyKind>(kind - kBodyKindNames.begin());
  return body;
}

BodyKind kind_by_tissues(const std::set<Tissue>& tissues) {
  return tissues == std::set<Tissue>{Tissue::kOther} ? BodyKind::kGum : BodyKind::kNeighbour;
}

void check(const std::vector<Body>& list, const char* option) {
  try {
    check_bodies(list);
  } catch (const Error& e) {
    throw CLI::ValidationError(option, e.what());
  }
}

}  // namespace

void add_body_option(CLI::App& sub, std::vector<std::string>& texts) {
  sub.add_option(
         "--body", texts,
         "Of a segmentation of several teeth, whose values are whose, one per option:\n"
         "NAME[:KIND]=VALUE[,VALUE...], kind tooth, neighbour or gum (default: gum if it is\n"
         "of 'other' only, else neighbour); what no --body names is the prepared tooth")
      ->allow_extra_args(false)
      ->excludes("--tooth")
      ->needs("--labels");
}

std::vector<BodyLabels> parse_body_labels(const std::vector<std::string>& texts,
                                          const std::map<std::uint16_t, Tissue>& tissues) {
  std::vector<BodyLabels> bodies;
  std::set<std::uint16_t> taken;
  for (const std::string& text : texts) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos)
      throw CLI::ValidationError("--body", "'" + text + "' is not NAME[:KIND]=VALUE[,VALUE...]");
    const NamedBody named = parse_name(text.substr(0, equals), "--body");
    BodyLabels body{{named.name, BodyKind::kNeighbour}, {}};
    std::set<Tissue> made_of;
    for (const std::string& part : CLI::detail::split(text.substr(equals + 1), ',')) {
      std::uint16_t value = 0;
      const bool number = CLI::detail::lexical_cast(part, value);
      if (!number || !tissues.contains(value))
        throw CLI::ValidationError(
            "--body", "'" + text + "': the value " + part + " is not among those of --labels");
      if (!taken.insert(value).second)
        throw CLI::ValidationError("--body", "the value " + part + " is given twice");
      body.values.push_back(value);
      made_of.insert(tissues.at(value));
    }
    body.body.kind = named.kind.value_or(kind_by_tissues(made_of));
    bodies.push_back(std::move(body));
  }
  if (bodies.empty()) return bodies;
  BodyLabels rest{{kPrepared, BodyKind::kTooth}, {}};
  for (const auto& [value, tissue] : tissues)
    if (!taken.contains(value)) rest.values.push_back(value);
  const auto prepared = std::find_if(bodies.begin(), bodies.end(), [](const BodyLabels& b) {
    return b.body.kind == BodyKind::kTooth;
  });
  if (!rest.values.empty() && prepared != bodies.end())
    prepared->values.insert(prepared->values.end(), rest.values.begin(), rest.values.end());
  else if (!rest.values.empty())
    bodies.insert(bodies.begin(), rest);
  std::vector<Body> list;
  for (const BodyLabels& b : bodies) list.push_back(b.body);
  check(list, "--body");
  return bodies;
}

void add_neighbour_option(CLI::App& sub, std::vector<std::string>& texts) {
  sub.add_option("--neighbour", texts,
                 "Keep another of several teeth as a neighbour of the one that --tooth takes, one "
                 "per option:\nNAME=N or NAME=X,Y,Z, chosen as by --tooth")
      ->allow_extra_args(false)
      ->excludes("--body")
      ->needs("--tooth");
}

std::vector<NeighbourChoice> parse_neighbours(const std::vector<std::string>& texts) {
  std::vector<NeighbourChoice> neighbours;
  std::vector<Body> list = {{kPrepared, BodyKind::kTooth}};
  for (const std::string& text : texts) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos)
      throw CLI::ValidationError("--neighbour", "'" + text + "' is not NAME=N or NAME=X,Y,Z");
    NeighbourChoice neighbour{{text.substr(0, equals), BodyKind::kNeighbour}, 1, {}};
    parse_tooth(text.substr(equals + 1), "--neighbour", neighbour.tooth, neighbour.tooth_at);
    list.push_back(neighbour.body);
    neighbours.push_back(std::move(neighbour));
  }
  check(list, "--neighbour");
  return neighbours;
}

void parse_tooth(const std::string& text, const char* option, int& tooth,
                 std::optional<Vec3>& tooth_at) {
  const auto parts = CLI::detail::split(text, ',');
  Vec3 at = Vec3::Zero();
  bool good = parts.size() == 3;
  for (std::size_t a = 0; a < 3 && good; ++a) {
    const auto value = decimal_number(parts[a]);
    good = value.has_value();
    at[static_cast<int>(a)] = value.value_or(0);
  }
  if (good)
    tooth_at = at;
  else if (parts.size() != 1 || !CLI::detail::lexical_cast(text, tooth) || tooth < 1)
    throw CLI::ValidationError(option,
                               "'" + text + "' is neither a number (1 is the largest) nor X,Y,Z");
}

BodyMeshes parse_body_meshes(const std::vector<std::string>& texts) {
  BodyMeshes meshes;
  std::vector<bool> has_kind;
  for (const std::string& text : texts) {
    const std::size_t equals = text.find('='), slash = text.substr(0, equals).find('/');
    const bool named = slash != std::string::npos;
    const NamedBody body = named ? parse_name(text.substr(0, slash), "--mesh")
                                 : NamedBody{kPrepared, BodyKind::kTooth};
    const std::string what =
        named ? text.substr(slash + 1, equals - slash - 1) : text.substr(0, equals);
    const auto tissue = tissue_named(what);
    if (equals == std::string::npos || !tissue || equals + 1 == text.size())
      throw CLI::ValidationError(
          "--mesh",
          "'" + text +
              "' is not [BODY/]TISSUE=FILE (enamel, dentin, pulp or other); a scan without layers "
              "takes --enamel-mm T, too: a model of its enamel");
    const auto at =
        static_cast<std::size_t>(std::find_if(meshes.list.begin(), meshes.list.end(),
                                              [&](const Body& b) { return b.name == body.name; }) -
                                 meshes.list.begin());
    if (at == meshes.list.size()) {
      meshes.list.push_back({body.name, BodyKind::kNeighbour});
      meshes.parts.emplace_back();
      has_kind.push_back(false);
    }
    if (body.kind) {
      meshes.list[at].kind = *body.kind;
      has_kind[at] = true;
    }
    for (const auto& [known, file] : meshes.parts[at])
      if (known == *tissue)
        throw CLI::ValidationError("--mesh", text.substr(0, equals) + " is given twice");
    meshes.parts[at].emplace_back(*tissue, text.substr(equals + 1));
  }
  for (std::size_t b = 0; b < meshes.list.size(); ++b) {
    std::set<Tissue> made_of;
    for (const auto& [tissue, file] : meshes.parts[b]) made_of.insert(tissue);
    if (!has_kind[b]) meshes.list[b].kind = kind_by_tissues(made_of);
  }
  check(meshes.list, "--mesh");
  return meshes;
}

}  // namespace toothprep::app
