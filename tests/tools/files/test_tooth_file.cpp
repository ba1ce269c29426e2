// A tooth file is what other programs see of a tooth: it must come back bit for bit, repeat byte
// for byte, and whatever is not a tooth must be refused by name before it can do harm.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <random>

#include "../../support/repetitions.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/tooth_file.h"

// OpenVDB leaks the grid that it was reading when a foreign file ends too early; that is not ours
// to fix. Asked for by the leak checker of sanitizer builds, never called otherwise.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() { return "leak:openvdb"; }

namespace toothprep {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class ToothFile : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(testing::TempDir()) / (std::string("toothfile_") + info->name());
    fs::create_directories(folder_);
    openvdb::initialize();
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  fs::path folder_;
};

LayeredTooth small_block() {
  BlockOptions o;
  o.size = Vec3(2, 3, 2);
  o.enamel = 1;
  o.pose.position = Vec3(-3.7, 0.123456789, 1e3 / 7);
  o.pose.orientation = orientation_of_axis(Vec3(1, 2, 3));
  LayeredTooth tooth = make_block(o);
  tooth.provenance = {{"source", "scan of J. D. (2021)"},
                      {"source_sha256", std::string(64, 'a')},
                      {"threshold_dentin_hu", "1250"}};
  return tooth;
}

std::string bytes_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
void put_bytes(const std::string& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

std::string refusal(const std::string& file) {
  try {
    static_cast<void>(read_tooth(file));
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr(file)) << "an error names its file";
    return e.what();
  }
  return "read without complaint";
}

// The grids of a written tooth, changed and saved by OpenVDB as another program would.
using Grids = std::map<std::string, openvdb::GridBase::Ptr>;
void resave(const std::string& from, const std::string& to,
            const std::function<void(Grids&)>& change,
            const std::function<void(openvdb::MetaMap&)>& change_meta = {}) {
  openvdb::io::File in(from);
  in.open(false);
  Grids grids;
  const openvdb::GridPtrVecPtr found = in.getGrids();
  for (const auto& grid : *found) grids[grid->getName()] = grid;
  openvdb::MetaMap meta(*in.getMetadata());
  change(grids);
  if (change_meta) change_meta(meta);
  openvdb::GridPtrVec all;
  for (const auto& [name, grid] : grids) all.push_back(grid);
  openvdb::io::File out(to);
  out.write(all, meta);
}
openvdb::FloatGrid& floats(Grids& grids, const std::string& name) {
  return *openvdb::gridPtrCast<openvdb::FloatGrid>(grids.at(name));
}

TEST_F(ToothFile, IsReadBackBitForBit) {
  const LayeredTooth tooth = small_block();
  write_tooth(tooth, path("a.vdb"));
  const LayeredTooth again = read_tooth(path("a.vdb"));
  EXPECT_EQ(tooth_sha256(again), tooth_sha256(tooth));
  EXPECT_EQ(again.provenance, tooth.provenance);
  EXPECT_EQ(again.lattice.voxel, tooth.lattice.voxel);
  EXPECT_EQ(again.lattice.origin, tooth.lattice.origin);
  EXPECT_EQ(again.solid.background(), tooth.solid.background());
  // The hash above could miss what it does not cover; look at every voxel too.
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
    const Index3 f = tooth.solid.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = f + Index3(v >> 6, (v >> 3) & 7, v & 7);
      ASSERT_EQ(again.solid.value(i.x(), i.y(), i.z()), tooth.solid.brick(b)[v]);
      ASSERT_EQ(again.tissue.value(i.x(), i.y(), i.z()), tooth.tissue.brick(b)[v]);
      for (int k = 0; k < 3; ++k)
        ASSERT_EQ(again.remains[k].value(i.x(), i.y(), i.z()), tooth.remains[k].brick(b)[v]);
    }
  }
}

TEST_F(ToothFile, UniformBricksNeedNoStorageAfterReading) {
  BlockOptions o;
  o.size = Vec3(4, 4, 4);
  const LayeredTooth tooth = make_block(o);
  write_tooth(tooth, path("a.vdb"));
  EXPECT_EQ(read_tooth(path("a.vdb")).solid.bricks_stored(), tooth.solid.bricks_stored());
}

// What a brick of a tissue takes: 128 bytes that say where its rows of four voxels are, a row of
// either side, and those rows that hold a value within the band.
std::size_t packed_bytes(const std::array<float, kBrickVoxels>& values, float band) {
  std::size_t rows = 2;
  for (std::size_t v = 0; v < kBrickVoxels; v += 4)
    rows += !(std::all_of(&values[v], &values[v] + 4, [&](float x) { return x == band; }) ||
              std::all_of(&values[v], &values[v] + 4, [&](float x) { return x == -band; }));
  return kBrickVoxels / 4 + rows * 4 * sizeof(float);
}

// At the tooth's surface a tissue's level set is the solid's, at a border of tissues the negative of
// dentin's.
TEST_F(ToothFile, BricksThatLevelSetsHaveInCommonAreStoredOnce) {
  BlockOptions o;
  o.size = Vec3(4, 4, 4);
  o.enamel = 2;
  o.pose.orientation = orientation_of_axis(Vec3(1, 2, 3));
  const LayeredTooth tooth = make_block(o);
  write_tooth(tooth, path("a.vdb"));
  LayeredTooth again = read_tooth(path("a.vdb"));
  std::size_t common = 0, opposite = 0, bytes = 0, written = 0;
  std::array<float, kBrickVoxels> values, negative;
  for (std::size_t b = 0; b < again.solid.table_size(); ++b)
    for (const PackedLevelSet& remains : again.remains) {
      if (remains.is_uniform(b)) continue;
      remains.brick(b).unpack(values.data());
      const bool as_solid = std::equal(values.begin(), values.end(), again.solid.brick(b));
      again.remains[1].brick(b).unpack(negative.data());
      for (float& v : negative) v = -v;
      if (!as_solid && values != negative) continue;
      ++(as_solid ? common : opposite);
      bytes += packed_bytes(values, again.solid.background());
      if (as_solid) written = b;
    }
  ASSERT_GT(common, 0u);
  ASSERT_GT(opposite, 0u);
  // Constants are there twice; the box may be another.
  const auto tables = [](const LayeredTooth& t) { return 5 * 4 * t.solid.table_size(); };
  EXPECT_EQ(memory_bytes(again) - tables(again) + bytes,
            memory_bytes(tooth) - tables(tooth) + kBrickVoxels * (2 * sizeof(float) + 5));

  const std::string sha256 = tooth_sha256(again);
  LayeredTooth copy = again;
  std::fill_n(copy.solid.writable_brick(written), kBrickVoxels, 0.0F);
  EXPECT_NE(tooth_sha256(copy), sha256);
  EXPECT_EQ(tooth_sha256(again), sha256);
  copy.solid = again.solid;
  EXPECT_EQ(tooth_sha256(copy), sha256);
}

TEST_F(ToothFile, CarvedAwayTeethKeepTheirAnatomy) {
  LayeredTooth tooth = small_block();
  LevelSet nothing = tooth.solid;
  for (std::size_t b = 0; b < nothing.table_size(); ++b)
    nothing.set_uniform(b, nothing.background());
  apply_remaining_solid(tooth, nothing);
  write_tooth(tooth, path("a.vdb"));
  const LayeredTooth again = read_tooth(path("a.vdb"));
  EXPECT_EQ(tooth_sha256(again), tooth_sha256(tooth));
  EXPECT_EQ(volume_mm3(again.solid, again.lattice.voxel), 0);
}

// A ball of 0.6 mm cut out of the block's middle, as Workpiece::cut() gives it.
LayeredTooth cut_block() {
  LayeredTooth tooth = small_block();
  const auto band = static_cast<float>(tooth.band());
  const Box box = bounds_of_solid(tooth);
  const Vec3 middle = 0.5 * (box.min + box.max);
  LevelSet cut(tooth.solid.first_brick(), tooth.solid.brick_counts(), -band, {band});
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x =
          tooth.lattice.to_world(cut.brick_origin(b) + Index3(v >> 6, (v >> 3) & 7, v & 7));
      values[v] = std::clamp(static_cast<float>(0.6 - (x - middle).norm()), -band, band);
    }
    cut.set_brick(b, values.data());
  }
  apply_cut(tooth, cut);
  return tooth;
}

TEST_F(ToothFile, APreparedToothKeepsItsIntactSurfaceAndTheCut) {
  const LayeredTooth tooth = cut_block();
  ASSERT_LT(volume_mm3(tooth.solid, 0.1), volume_mm3(tooth.parts->intact, 0.1) - 0.5);
  write_tooth(tooth, path("a.vdb"));
  const LayeredTooth again = read_tooth(path("a.vdb"));
  ASSERT_TRUE(again.parts);
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
    const Index3 f = tooth.solid.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = f + Index3(v >> 6, (v >> 3) & 7, v & 7);
      ASSERT_EQ(again.parts->intact.value(i.x(), i.y(), i.z()), tooth.parts->intact.brick(b)[v]);
      ASSERT_EQ(again.parts->cut.value(i.x(), i.y(), i.z()), tooth.parts->cut.brick(b)[v]);
      ASSERT_EQ(again.solid.value(i.x(), i.y(), i.z()),
                std::max(tooth.parts->intact.brick(b)[v], -tooth.parts->cut.brick(b)[v]));
    }
  }
  write_tooth(again, path("b.vdb"));
  EXPECT_EQ(bytes_of(path("a.vdb")), bytes_of(path("b.vdb")));
  resave(path("a.vdb"), path("c.vdb"), [](Grids& g) {
    for (auto& [name, grid] : g)
      if (name != "tissue") grid->setSaveFloatAsHalf(true);
  });
  EXPECT_TRUE(read_tooth(path("c.vdb")).parts) << "half floats are no contradiction";
}

// The same, with ways of two burs through it, a part each.
LayeredTooth cut_block_with_way() {
  LayeredTooth tooth = cut_block();
  CutWay way{{"line 0 0 0.6 0; line 0.6 0 0.6 3; line 0.6 3 0 3",
              "arc 0 0 0.5 0.5 0 0.5 convex; line 0.5 0.5 0.5 2; line 0.5 2 0 2"},
             {},
             {}};
  const Quat leant(Eigen::AngleAxisd(0.3, Vec3(1, 2, 3).normalized()));
  way.parts.push_back({Pose{Vec3(1.0 / 3, -2e-7, 0.1), leant}, Vec3(0.7, 1e-3, 0), 1e-5, false});
  way.parts.push_back({Pose{Vec3(1, 0, 0.1), leant}, Vec3(0, 0, 0.2), 0, true, 1});
  way.deepest = BrickGrid<float>(tooth.solid.first_brick(), tooth.solid.brick_counts(), 0, {0});
  std::array<float, kBrickVoxels> numbers{};
  for (std::size_t b = 0; b < way.deepest.table_size(); b += 2) {
    for (int v = 0; v < kBrickVoxels; ++v) numbers[v] = static_cast<float>(v % 3);
    way.deepest.set_brick(b, numbers.data());
  }
  tooth.parts->way = std::move(way);
  return tooth;
}

TEST_F(ToothFile, APreparedToothKeepsItsIntactTissuesAndTheBursWay) {
  const LayeredTooth tooth = cut_block_with_way();
  write_tooth(tooth, path("a.vdb"));
  const LayeredTooth again = read_tooth(path("a.vdb"));
  ASSERT_TRUE(again.parts->tissues && again.parts->way);
  const CutWay &was = *tooth.parts->way, &is = *again.parts->way;
  int changed = 0;
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
    const Index3 f = tooth.solid.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = f + Index3(v >> 6, (v >> 3) & 7, v & 7);
      for (std::size_t k = 0; k < 3; ++k) {
        const float intact = (*tooth.parts->tissues)[k].brick(b)[v];
        ASSERT_EQ((*again.parts->tissues)[k].value(i.x(), i.y(), i.z()), intact);
        changed += intact != tooth.remains[k].brick(b)[v];
      }
      ASSERT_EQ(is.deepest.value(i.x(), i.y(), i.z()), was.deepest.brick(b)[v]);
    }
  }
  EXPECT_GT(changed, 500);
  EXPECT_EQ(is.heads, was.heads);
  ASSERT_EQ(is.parts.size(), was.parts.size());
  for (std::size_t n = 0; n < is.parts.size(); ++n) {
    EXPECT_EQ(is.parts[n].from.position, was.parts[n].from.position);
    EXPECT_EQ(is.parts[n].from.orientation.coeffs(), was.parts[n].from.orientation.coeffs());
    EXPECT_EQ(is.parts[n].way, was.parts[n].way);
    EXPECT_EQ(is.parts[n].aside, was.parts[n].aside);
    EXPECT_EQ(is.parts[n].goes_on, was.parts[n].goes_on);
    EXPECT_EQ(is.parts[n].head, was.parts[n].head);
  }
  write_tooth(again, path("b.vdb"));
  EXPECT_EQ(bytes_of(path("a.vdb")), bytes_of(path("b.vdb")));
  EXPECT_EQ(tooth_sha256(again), tooth_sha256(cut_block()));
  resave(path("a.vdb"), path("c.vdb"), [](Grids& g) {
    EXPECT_LT(floats(g, "intact_enamel").tree().leafCount(), floats(g, "enamel").tree().leafCount())
        << "only blocks that changed";
    for (const char* name : {"intact_enamel", "intact_dentin", "intact_pulp", "cut_by"})
      g.erase(name);
  });
  const LayeredTooth older = read_tooth(path("c.vdb"));
  EXPECT_TRUE(older.parts && !older.parts->tissues && !older.parts->way) << "a file of before";
}

TEST_F(ToothFile, IntactTissuesAndAWayThatCannotBeTheToothsAreRefusedByName) {
  write_tooth(cut_block_with_way(), path("a.vdb"));
  const auto refused = [this](const std::function<void(Grids&)>& change) {
    resave(path("a.vdb"), path("b.vdb"), change);
    return refusal(path("b.vdb"));
  };
  EXPECT_THAT(refused([](Grids& g) { g.erase("intact_pulp"); }),
              HasSubstr("has some of the grids 'intact_enamel'"));
  EXPECT_THAT(refused([](Grids& g) {
                for (auto value = floats(g, "intact_enamel").beginValueOn(); value; ++value)
                  value.setValue(*value + 0.02F);
              }),
              HasSubstr("grid 'intact_enamel': is at odds with 'enamel' and 'solid'"));
  EXPECT_THAT(refused([](Grids& g) { g.erase("intact"), g.erase("cut"); }),
              HasSubstr("'intact_enamel'"));
  const auto way = [](Grids& g) { return openvdb::gridPtrCast<openvdb::Int32Grid>(g["cut_by"]); };
  EXPECT_THAT(refused([&](Grids& g) { way(g)->beginValueOn().setValue(3); }),
              HasSubstr("grid 'cut_by': holds the number 3, but its list has 2 entries"));
  EXPECT_THAT(refused([&](Grids& g) { way(g)->beginValueOn().setValue(-1); }),
              HasSubstr("grid 'cut_by': holds the number -1"));
  EXPECT_THAT(refused([&](Grids& g) { way(g)->removeMeta("bur_way"); }),
              HasSubstr("grid 'cut_by': has no metadata 'bur_way'"));
  EXPECT_THAT(refused([&](Grids& g) {
                way(g)->setTransform(openvdb::math::Transform::createLinearTransform(0.2));
              }),
              HasSubstr("grid 'cut_by': lies on another lattice"));
  const auto text = [&](const std::function<void(std::string&)>& change) {
    return refused([&](Grids& g) {
      std::string now = way(g)->metaValue<std::string>("bur_way");
      change(now);
      way(g)->removeMeta("bur_way");
      way(g)->insertMeta("bur_way", openvdb::StringMetadata(now));
    });
  };
  const auto instead = [&](const std::string& of, const std::string& put) {
    return text([&](std::string& now) {
      const std::size_t at = now.find(of);
      ASSERT_NE(at, std::string::npos) << of << " in " << now;
      now.replace(at, of.size(), put);
    });
  };
  EXPECT_THAT(text([](std::string& now) { now.resize(now.size() / 2); }),
              HasSubstr("bur_way: isn't JSON with heads, columns and parts"));
  EXPECT_THAT(text([](std::string& now) { now.clear(); }), HasSubstr("bur_way: isn't JSON"));
  EXPECT_THAT(instead("x_mm", "x_in"), HasSubstr("bur_way: has other columns"));
  EXPECT_THAT(instead("-2e-07", "[]"), HasSubstr("bur_way: part 1 isn't 13 numbers"));
  EXPECT_THAT(instead("-2e-07,", ""), HasSubstr("bur_way: part 1 isn't 13 numbers"));
  EXPECT_THAT(instead("-2e-07", "1e300"), HasSubstr("bur_way: part 1 holds a number beyond 1e4"));
  EXPECT_THAT(instead("1e-05", "-1"), HasSubstr("bur_way: part 1 has a negative aside_mm"));
  EXPECT_THAT(instead("\"parts\":[[", "\"parts\":[[0,0,0,0,0,0,2,0,0,0,0,0,0],["),
              HasSubstr("bur_way: part 1 has an orientation that is no unit quaternion"));
  for (const char* number : {"2", "-1", "0.5"})
    EXPECT_THAT(instead("1,1]]", std::string("1,") + number + "]]"),
                HasSubstr("bur_way: part 2 has no head of the list"));
  EXPECT_THAT(instead("\"line 0 0 0.6 0;", "7,\"line 0 0 0.6 0;"),
              HasSubstr("bur_way: has a head that isn't text"));
  for (const char* piece : {"lime 0 0 0.6 0", "line 0 0 0.6", "line 0 0 0.6 nan",
                            "line 0 0 0.6 0 0", "arc 0 0 0.6 0 0.3 0 bent", ""})
    EXPECT_THAT(instead("line 0 0 0.6 0;", std::string(piece) + ";"),
                HasSubstr("is no piece of an outline"));
  EXPECT_THAT(instead("line 0 0 0.6 0;", "line 0 0 0.5 0;"), HasSubstr("bur_way: "));
}

TEST_F(ToothFile, AnIntactToothHasNoParts) {
  write_tooth(small_block(), path("a.vdb"));
  EXPECT_FALSE(read_tooth(path("a.vdb")).parts);
  resave(path("a.vdb"), path("b.vdb"), [](Grids& g) {
    EXPECT_EQ(g.count("cut"), 0u);
    EXPECT_EQ(g.count("intact"), 0u);
  });
}

TEST_F(ToothFile, PartsThatDoNotMakeTheSolidAreRefusedByName) {
  write_tooth(cut_block(), path("a.vdb"));
  const auto refused = [&](const std::function<void(Grids&)>& change) {
    resave(path("a.vdb"), path("b.vdb"), change);
    return refusal(path("b.vdb"));
  };
  EXPECT_THAT(refused([](Grids& g) { g.erase("intact"); }),
              HasSubstr("grid 'intact': is missing, though there is 'cut'"));
  EXPECT_THAT(refused([](Grids& g) { g.erase("cut"); }), HasSubstr("grid 'cut': is missing"));
  EXPECT_THAT(refused([](Grids& g) {
                floats(g, "cut").setTransform(openvdb::math::Transform::createLinearTransform(0.2));
              }),
              HasSubstr("grid 'cut': lies on another lattice"));
  EXPECT_THAT(refused([](Grids& g) {
                floats(g, "cut").beginValueOn().setValue(std::numeric_limits<float>::quiet_NaN());
              }),
              HasSubstr("grid 'cut': holds a value that is not a finite number"));
  EXPECT_THAT(refused([](Grids& g) {
                for (auto value = floats(g, "solid").beginValueOn(); value; ++value)
                  value.setValue(*value + 0.002F);
              }),
              HasSubstr("grid 'solid': is not what 'cut' leaves of 'intact'"));
}

TEST_F(ToothFile, SameToothMakesTheSameBytesWhateverTheThreads) {
  const LayeredTooth tooth = small_block();
  write_tooth(tooth, path("a.vdb"));
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    write_tooth(small_block(), path("b.vdb"));
  }
  write_tooth(read_tooth(path("a.vdb")), path("c.vdb"));
  EXPECT_EQ(bytes_of(path("a.vdb")), bytes_of(path("b.vdb")));
  EXPECT_EQ(bytes_of(path("a.vdb")), bytes_of(path("c.vdb")))
      << "a copy of a copy is the same file";
}

TEST_F(ToothFile, OtherContentHasAnotherArchiveId) {
  LayeredTooth tooth = small_block();
  write_tooth(tooth, path("a.vdb"));
  tooth.provenance["source"] = "another";
  write_tooth(tooth, path("b.vdb"));
  EXPECT_NE(bytes_of(path("a.vdb")).substr(21, 36), bytes_of(path("b.vdb")).substr(21, 36));
}

TEST_F(ToothFile, OpenVdbSeesLevelSetsInMillimetresAndTheDocumentedKeys) {
  const LayeredTooth tooth = small_block();
  write_tooth(tooth, path("a.vdb"));
  openvdb::io::File file(path("a.vdb"));
  file.open();
  const openvdb::MetaMap::Ptr metadata = file.getMetadata();
  const openvdb::MetaMap& meta = *metadata;
  EXPECT_EQ(meta.metaValue<std::string>("toothprep_schema"), "toothprep-tooth");
  EXPECT_EQ(meta.metaValue<std::int32_t>("toothprep_schema_version"), 1);
  EXPECT_EQ(meta.metaValue<double>("voxel_mm"), 0.1);
  EXPECT_EQ(meta.metaValue<std::string>("tooth_sha256"), tooth_sha256(tooth));
  // 2 x 3 x 2 mm with 1 mm of enamel: 4 mm3 of enamel, 8 of dentin; a turned block's volume is of
  // second order in the voxel, so a few percent of a voxel layer.
  EXPECT_NEAR(meta.metaValue<double>("volume_mm3_enamel"), 4.0, 0.05);
  EXPECT_NEAR(meta.metaValue<double>("volume_mm3_dentin"), 8.0, 0.1);
  EXPECT_EQ(meta.metaValue<double>("volume_mm3_pulp"), 0.0);
  for (const char* name : {"solid", "enamel", "dentin", "pulp"}) {
    const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid(name));
    ASSERT_TRUE(grid) << name;
    EXPECT_EQ(grid->getGridClass(), openvdb::GRID_LEVEL_SET);
    EXPECT_FLOAT_EQ(grid->background(), 0.3F);
    for (auto it = grid->cbeginValueOn(); it; ++it) ASSERT_LT(std::abs(*it), grid->background());
  }
  const auto solid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("solid"));
  const openvdb::Vec3d at = solid->transform().indexToWorld(openvdb::Vec3d(7, 8, 9));
  EXPECT_LT((Vec3(at[0], at[1], at[2]) - tooth.lattice.to_world(Index3(7, 8, 9))).norm(), 1e-12)
      << "an index is a voxel's centre";
  const auto tissue = openvdb::gridPtrCast<openvdb::Int32Grid>(file.readGrid("tissue"));
  ASSERT_TRUE(tissue);
  for (auto it = tissue->cbeginValueOn(); it; ++it) ASSERT_NE(*it, 0);
  for (auto it = tissue->cbeginValueOff(); it; ++it) ASSERT_EQ(*it, 0);
}

TEST_F(ToothFile, PyopenvdbReadsLevelSetsMetadataAndVolume) {
  const std::string python = "/usr/bin/python3";
  if (std::system((python + " -c 'import numpy, pyopenvdb' 2>/dev/null").c_str()) != 0)
    GTEST_SKIP() << "pyopenvdb (package python3-openvdb) is not installed";
  const LayeredTooth tooth = small_block();
  write_tooth(tooth, path("a.vdb"));
  char volume[40];
  std::snprintf(volume, sizeof volume, "%.17g", volume_mm3(tooth.solid, tooth.lattice.voxel));
  EXPECT_EQ(
      std::system((python + " " TOOTHPREP_SOURCE_DIR "/tests/tools/files/read_with_pyopenvdb.py '" +
                   path("a.vdb") + "' 0.1 " + volume + " " + tooth_sha256(tooth))
                      .c_str()),
      0);
}

TEST_F(ToothFile, SurvivesBeingResavedByAnotherProgram) {
  const LayeredTooth tooth = small_block();
  write_tooth(tooth, path("a.vdb"));
  resave(
      path("a.vdb"), path("b.vdb"), [](Grids&) {},
      [](openvdb::MetaMap& meta) { meta.clearMetadata(); });
  EXPECT_EQ(tooth_sha256(read_tooth(path("b.vdb"))), tooth_sha256(tooth));
}

TEST_F(ToothFile, AResavedToothThatIsNoLongerTheSameIsReported) {
  write_tooth(small_block(), path("a.vdb"));
  EXPECT_THAT(read_tooth_with_warnings(path("a.vdb")).warnings, IsEmpty());
  resave(path("a.vdb"), path("b.vdb"), [](Grids&) {});
  EXPECT_THAT(read_tooth_with_warnings(path("b.vdb")).warnings, IsEmpty());
  const auto carve = [](Grids& g) {
    for (auto value = floats(g, "solid").beginValueOn(); value; ++value)
      value.setValue(*value + 0.01F);
  };
  const auto keep = [](openvdb::MetaMap&) {};
  const auto drop = [](openvdb::MetaMap& meta) { meta.clearMetadata(); };
  resave(path("a.vdb"), path("c.vdb"), carve, keep);
  resave(path("a.vdb"), path("d.vdb"), carve, drop);  // the grids' metadata stay
  for (const char* name : {"c.vdb", "d.vdb"})
    EXPECT_THAT(read_tooth_with_warnings(path(name)).warnings,
                ElementsAre(HasSubstr("is not the tooth that its tooth_sha256 is of")))
        << name;
}

TEST_F(ToothFile, AToothWhereNoToothLiesIsReported) {
  write_tooth(small_block(), path("a.vdb"));
  for (const double away : {1e7, -1e12}) {
    resave(path("a.vdb"), path("b.vdb"), [&](Grids& g) {
      for (auto& [name, grid] : g) grid->transform().postTranslate(openvdb::Vec3d(away, 0, 0));
    });
    EXPECT_THAT(read_tooth_with_warnings(path("b.vdb")).warnings,
                Contains(HasSubstr(" mm from the origin, where no scan has it")))
        << away;
  }
}

TEST_F(ToothFile, VoxelsOfKilometresAreRefused) {
  write_tooth(small_block(), path("a.vdb"));
  resave(path("a.vdb"), path("b.vdb"), [](Grids& g) {
    for (auto& [name, grid] : g)
      grid->setTransform(openvdb::math::Transform::createLinearTransform(1e29));
  });
  EXPECT_THAT(refusal(path("b.vdb")), HasSubstr("b.vdb"));
}

TEST_F(ToothFile, DamageInFilesOfOtherProgramsIsRefusedOrHarmless) {
  write_tooth(small_block(), path("a.vdb"));
  resave(path("a.vdb"), path("b.vdb"), [](Grids&) {});
  const std::string whole = bytes_of(path("b.vdb"));
  std::mt19937 random(1);
  const int many = flips(60);
  int refused = 0;
  for (int i = 0; i < many; ++i) {
    std::string broken = whole;
    for (int k = 0; k <= i % 3; ++k) broken[random() % broken.size()] = static_cast<char>(random());
    put_bytes(path("c.vdb"), broken);
    try {
      static_cast<void>(read_tooth(path("c.vdb")));
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, many / 5);
}

TEST_F(ToothFile, HalfFloatsAreReadToTheirPrecision) {
  const LayeredTooth tooth = small_block();
  write_tooth(tooth, path("a.vdb"));
  resave(path("a.vdb"), path("b.vdb"), [](Grids& g) {
    for (const char* name : {"solid", "enamel", "dentin", "pulp"})
      g[name]->setSaveFloatAsHalf(true);
  });
  const LayeredTooth again = read_tooth(path("b.vdb"));
  const double voxel = tooth.lattice.voxel;
  // Half floats carry 11 bits: 0.3 mm is met to 0.3 * 2^-11.
  for (int i = 0; i < 40; ++i)
    EXPECT_NEAR(again.solid.value(i - 10, 2 - i, 3), tooth.solid.value(i - 10, 2 - i, 3), 2e-4);
  EXPECT_NEAR(volume_mm3(again.solid, voxel), volume_mm3(tooth.solid, voxel), 1e-3);
}

TEST_F(ToothFile, AnyDamageIsNoticedBeforeItCanCrashTheReader) {
  write_tooth(small_block(), path("a.vdb"));
  const std::string whole = bytes_of(path("a.vdb"));
  for (std::size_t i = 8; i < whole.size(); i += 1 + whole.size() / 200) {
    if (i == 21 + 14) continue;  // the digit that says whether the id is a checksum
    std::string broken = whole;
    broken[i] = static_cast<char>(broken[i] ^ 0x55);
    put_bytes(path("b.vdb"), broken);
    ASSERT_THROW(static_cast<void>(read_tooth(path("b.vdb"))), InputError) << "byte " << i;
  }
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{4}, std::size_t{40}, whole.size() / 2, whole.size() - 1}) {
    put_bytes(path("b.vdb"), whole.substr(0, size));
    const std::string message = refusal(path("b.vdb"));
    if (size >= 8) {
      EXPECT_THAT(message, HasSubstr("truncated")) << size;
    }
  }
}

TEST_F(ToothFile, TruncatedFilesOfOtherProgramsAreRefusedToo) {
  write_tooth(small_block(), path("a.vdb"));
  resave(path("a.vdb"), path("b.vdb"), [](Grids&) {});
  const std::string whole = bytes_of(path("b.vdb"));
  for (int part = 1; part < 40; ++part) {
    put_bytes(path("c.vdb"), whole.substr(0, whole.size() * part / 40));
    ASSERT_THROW(static_cast<void>(read_tooth(path("c.vdb"))), InputError) << part;
  }
}

TEST_F(ToothFile, WhatIsNotAToothIsRefusedByName) {
  EXPECT_THAT(refusal(path("absent.vdb")), HasSubstr("does not exist"));
  EXPECT_THAT(refusal(folder_.string()), HasSubstr("is a folder"));
  put_bytes(path("empty.vdb"), "");
  EXPECT_THAT(refusal(path("empty.vdb")), HasSubstr("is empty"));
  put_bytes(path("text.vdb"), "solid cube\nfacet normal 0 0 1\n");
  EXPECT_THAT(refusal(path("text.vdb")), HasSubstr("not an OpenVDB file"));
  const auto sphere = openvdb::FloatGrid::create(0.3F);
  sphere->setName("solid");
  openvdb::io::File(path("sphere.vdb")).write(openvdb::GridPtrVec{sphere});
  EXPECT_THAT(refusal(path("sphere.vdb")), HasSubstr("toothprep_schema"));
}

TEST_F(ToothFile, EveryWrongGridIsRefusedByNameAndCondition) {
  write_tooth(small_block(), path("a.vdb"));
  const auto changed = [&](const std::function<void(Grids&)>& change,
                           const std::function<void(openvdb::MetaMap&)>& meta = {}) {
    resave(path("a.vdb"), path("b.vdb"), change, meta);
    return refusal(path("b.vdb"));
  };
  const auto put = [](const char* name, float value) {
    return [name, value](Grids& g) {
      floats(g, name).tree().setValue(openvdb::Coord(1, 2, 3), value);
    };
  };
  for (const char* name : {"tissue", "solid", "enamel", "dentin", "pulp"}) {
    const std::string message = changed([name](Grids& g) { g.erase(name); });
    EXPECT_THAT(message, HasSubstr(std::string("'") + name + "': is missing"));
  }
  EXPECT_THAT(changed([](Grids& g) {
                g["solid"] = openvdb::DoubleGrid::create(0.3);
                g["solid"]->setName("solid");
              }),
              HasSubstr("'solid': holds double values instead of float"));
  EXPECT_THAT(changed(put("enamel", std::nanf(""))),
              HasSubstr("'enamel': holds a value that is not"));
  EXPECT_THAT(changed(put("pulp", std::numeric_limits<float>::infinity())), HasSubstr("'pulp'"));
  for (const int label : {-1, 5, 1 << 20})
    EXPECT_THAT(changed([label](Grids& g) {
                  openvdb::gridPtrCast<openvdb::Int32Grid>(g["tissue"])
                      ->tree()
                      .setValue(openvdb::Coord(1, 2, 3), label);
                }),
                HasSubstr("label " + std::to_string(label)));
  EXPECT_THAT(
      changed([](Grids& g) { openvdb::gridPtrCast<openvdb::Int32Grid>(g["tissue"])->clear(); }),
      HasSubstr("'tissue': is empty"));
  EXPECT_THAT(changed([](Grids& g) {
                g["solid"]->transform().postTranslate({0.05, 0, 0});
              }),
              HasSubstr("'solid': lies on another lattice"));
  EXPECT_THAT(changed([](Grids& g) {
                for (auto& [name, grid] : g) grid->transform().postRotate(0.1);
              }),
              HasSubstr("rotated"));
  EXPECT_THAT(changed([](Grids& g) {
                for (auto& [name, grid] : g) grid->transform().postScale(openvdb::Vec3d(1, 1, 2));
              }),
              HasSubstr("not cubes"));
  EXPECT_THAT(changed([](Grids& g) {
                for (auto& [name, grid] : g) grid->transform().postScale(-1.0);
              }),
              HasSubstr("voxel size"));
  EXPECT_THAT(changed([](Grids& g) {
                for (auto& [name, grid] : g) grid->transform().postScale(1000.0);
              }),
              HasSubstr("voxel size is 100 mm"))
      << "a tooth in micrometres";
  EXPECT_THAT(changed([](Grids& g) {
                for (auto& [name, grid] : g) grid->transform().postScale(0.001);
              }),
              HasSubstr("narrow-band level set in mm"))
      << "voxels in metres, distances in mm";
  EXPECT_THAT(changed([](Grids& g) { floats(g, "solid").tree().root().setBackground(0, false); }),
              HasSubstr("'solid': is not a narrow-band level set"))
      << "a fog volume";
  EXPECT_THAT(changed([](Grids&) {},
                      [](openvdb::MetaMap& m) {
                        m.insertMeta("toothprep_schema",
                                     openvdb::StringMetadata("toothprep-trace"));
                      }),
              HasSubstr("is 'toothprep-trace' instead of"));
  EXPECT_THAT(changed([](Grids&) {},
                      [](openvdb::MetaMap& m) {
                        m.insertMeta("toothprep_schema_version", openvdb::Int32Metadata(2));
                      }),
              HasSubstr("toothprep_schema_version: is 2"));
}

TEST_F(ToothFile, AbsurdSizesAreRefusedWithoutAllocating) {
  write_tooth(small_block(), path("a.vdb"));
  for (const int far : {100000, 1 << 30, -(1 << 30)}) {
    resave(path("a.vdb"), path("b.vdb"), [far](Grids& g) {
      floats(g, "solid").tree().setValue(openvdb::Coord(far, far, 0), 0.05F);
    });
    EXPECT_THAT(refusal(path("b.vdb")), HasSubstr("2^33")) << far;
  }
  resave(path("a.vdb"), path("b.vdb"), [](Grids& g) {
    floats(g, "dentin").tree().addTile(3, openvdb::Coord(0, 0, 0), -0.3F, false);
  });
  EXPECT_THAT(refusal(path("b.vdb")), HasSubstr("2^33")) << "an inside tile of 4096 cubed";
  resave(path("a.vdb"), path("b.vdb"), [](Grids& g) {
    floats(g, "dentin").tree().addTile(2, openvdb::Coord(0, 0, 0), -0.05F, true);
  });
  EXPECT_THAT(refusal(path("b.vdb")), HasSubstr("tile of -0.05"));
}

}  // namespace
}  // namespace toothprep
