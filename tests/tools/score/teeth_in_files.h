// Teeth in a scratch folder, and what their assessment says.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>

#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/score/assess.h"

namespace toothprep {

class TeethInFiles : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern =
        (std::filesystem::temp_directory_path() / "toothprep-assess-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string put(const std::string& name, const LayeredTooth& tooth) const {
    write_tooth(tooth, path(name));
    return path(name);
  }
  std::string put(const std::string& name, const TriangleMesh& mesh) const {
    write_mesh(mesh, path(name));
    return path(name);
  }

  // The files of a specimen, to be assessed as that type.
  AssessmentOptions files_of(const LayeredTooth& original, const LayeredTooth& prepared,
                             PreparationType type) const {
    AssessmentOptions options;
    options.original = put("original.vdb", original);
    options.prepared = put("prepared.vdb", prepared);
    options.type = type;
    return options;
  }
  AssessmentOptions files_of(const CavityOptions& cavity, PreparationType type) const {
    const CavitySpecimen specimen = make_cavity(cavity);
    return files_of(specimen.original, specimen.prepared, type);
  }

 private:
  std::filesystem::path folder_;
};

inline double value_of(const Assessment& assessment, const std::string& key) {
  const Quantity* q = find_quantity(assessment.sheet.quantities, key);
  return q ? q->value : NAN;
}

inline Pose turned_pose() {
  Pose pose;
  pose.orientation = orientation_of_axis(Vec3(0.31, -0.52, 0.79), 0.7).normalized();
  pose.position = Vec3(3.13, -2.27, 11.41);
  return pose;
}

inline CavityOptions class1_box(double taper) {
  CavityOptions o;
  o.size = Vec3(6.5, 4.5, 5.5);
  o.enamel = 1.2;
  o.taper_u_plus = o.taper_u_minus = o.taper_v_plus = o.taper_v_minus = taper;
  return o;
}

inline CavityOptions class2_box() {
  CavityOptions o = class1_box(3);
  o.kind = CavityKind::kClass2;
  o.size = Vec3(8, 5, 6);
  o.axial_taper = 4;
  o.proximal_taper = 3;
  o.neighbour_gap = 0.4;
  return o;
}

inline CavityOptions round_stump(double convergence) {
  CavityOptions o;
  o.kind = CavityKind::kStump;
  o.size = Vec3(6, 5.5, 6);
  o.corner = 3;
  o.enamel = 1.2;
  o.occlusal_reduction = 1;
  o.shoulder_level = 4;
  o.convergence_u = o.convergence_v = convergence;
  return o;
}

}  // namespace toothprep
