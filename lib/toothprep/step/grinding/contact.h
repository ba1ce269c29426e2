// Contact of the level-set engine: which elements of the bur's surface touch tissue, and how much
// of each. The law that they follow stands in contact_set.h.
//
// An element is in contact where tissue is met a small reach ahead of the surface, along the element's
// own velocity: ahead of fresh tissue that is the same as along the normal, and in a slot that is
// passed again it stays in the void instead of touching the walls. What is found there is taken back
// to the surface by the gradient.
//
// An element that is engaged as a whole counts by Gauss points. One that a surface crosses (of the
// tooth, of a cut, of the border of two tissues), or over which v·n changes its sign, is divided
// into four pieces with a sample each. A piece counts by the part of it that is covered and by the
// place of that part's middle (covered_part.h), so that v·n is that of what is covered; with the
// piece's own the work of overlapping passes is too high.
//
// The level set of the cut is the deepest of all cuts, and the bur's own last cut, a voxel or two
// behind it, can hide the wall of an earlier one from the sample at the surface. So a second sample,
// farther ahead, looks for it, and a third one where the print is near there too: a wall that runs along
// the motion is the same there (on a path that bends as an arc both samples lie on that), and where two of them meet
// in a ridge or a groove, which the lattice rounds, each is looked at beside it. Where the surface is nearly parallel to the motion the second sample also tells
// fresh tissue, which the bur's own last cut bends away from, from the wall of a slot that is passed again.
//
// Where two walls meet within a piece, the value in its middle doesn't tell where it is divided; it is looked
// at where the border should be. Where the cut and the tooth's own surface cross the same piece, what lies
// under both counts. Where the border of two tissues does, each of them counts by its own part.
//
// From step to step little changes. What was found of an element as a whole is kept until the bur
// has moved by half of the distance at which it could be different, or a cut was put in place. Straight
// on, a whole sample stands for a hundredth of a piece's size, if nothing is reached by then.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/grinding/contact_set.h"
#include "toothprep/step/grinding/covered_part.h"
#include "toothprep/step/grinding/kept_cells.h"
#include "toothprep/step/grinding/known_sweep.h"
#include "toothprep/step/grinding/sweep_history.h"
#include "toothprep/step/grinding/swept_slot.h"
#include "toothprep/step/grinding/wall_curvature.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

// An element is this many pieces of `engine.element_mm` wide.
constexpr int kPiecesAcross = 2;

class ContactModel {
 public:
  static constexpr std::size_t kMostBeen = 16;  // poses that sample() takes besides its own

  // Keeps a reference to the bur. Pieces of at most `piece_size` mm; u and alpha per tissue (validated by the caller).
  ContactModel(const Bur& bur, double piece_size, bool clockwise,
               const PerTissue<GrindingProperties>& tissue);

  // Finds the elements in contact for a bur at `pose` that moves with trial velocity v (mm/s, B,
  // not zero unless omega turns it) and turns with omega (rad/s, B). `reach` in mm. Elements that
  // face away from the motion by more than a margin of 3° are left out; see covers(). `cuts`: any
  // number that changes when the cut does. What a bur at one of the first kMostBeen poses of
  // `been` takes up is void, whether or not the lattice has it; so is what a straight part of `history` took where the bur
  // moves along that again, and no ridge is left where one of them went.
  // Allocates nothing.
  void sample(const Workpiece& workpiece, const Pose& pose, const Vec3& v, const Vec3& omega,
              double reach, std::uint64_t cuts = 0, std::span<const Pose> been = {},
              const SweepHistory* history = nullptr) noexcept;

  // Whether every element that advances with v was considered by the last sample(), as far as the
  // velocity goes (omega is the handle's and doesn't change within a step).
  bool covers(const Vec3& v) const noexcept;

  // What the last sample() found.
  const ContactSet& contact() const { return contact_; }

  struct IndexFrame;

 private:
  static constexpr int kPieces = 4;  // of a divided element: as many as a vector has lanes
  // Of each element four points of the surface that stand for its pieces.
  struct Pieces {
    std::vector<float> x, y, z;                                     // mm, B
    std::vector<float> nx, ny, nz, tx, ty, lx, ly, lz, mx, my, mz;  // as of SurfaceElements; r x n
    std::vector<float> weight, arm;                                 // dphi dl and r, mm
    std::vector<float> half_along, half_around;                     // mm
    std::vector<float> curvature_around;                            // 1/mm
  };
  // What was found of an element as a whole.
  enum class Found : std::int32_t {
    kVoid,    // nothing in contact
    kInside,  // all of it
    kCrossed  // by a wall, a surface or a border, or possibly so
  };
  struct Standing {
    bool inside_tooth = false;  // of the tooth's surface, as a whole
    bool strips = false;        // what crosses it runs along the profile
    bool oblique = false;       // the tooth's surface crosses it obliquely
    std::uint8_t only = 0;      // the label of the one tissue that it lies in, or 0
    float share = 0;            // of it in contact, roughly
    // Of each of its pieces what is covered, its middle, by which lines, and the same of each tissue; see settled_.
    std::array<float, kPieces> covered{}, x{}, y{};
    Crossing crossing;
    std::array<double, kPieces> slots_from{};    // mm of way, from which on slots are looked for
    double parts_from = 0, parts_here_from = 0;  // likewise, for known parts of the way
    bool by_sweeps = false;                      // what is divided is known by sweeps
    double holds = 0;                            // as of settled_, but for a whole sample
    Float4 rise{};                               // as of Lanes
    Int4 by_rates{};
    CoveredPart<Float4> per_way{};
    // The same of what the cut alone covers.
    CoveredPart<Float4> by_cut{}, cut_per_way{};
    Crossing cut;
    Int4 cut_by_sweeps{}, cut_by_rates{};
    Float4 cut_rise{};
    double cut_path = 0;
    double path = 0;        // where that was found, as path_
    ContactSet::Sums sums;  // of what is covered of them
    int summed = -1;        // so many of them; -1: not yet
    int tissue = -1;        // of all of them, or -1: as of_tissue has it
    CoveredPart<Float4> of_tissue[kTissueCount] = {};
  };
  // One sample under way.
  struct Scan;
  // The pieces of an element under way.
  struct Lanes;
  // Their axes.
  struct PieceAxes;
  struct CutOfPieces;
  struct Place;
  struct AlongWay;
  struct FromPrint;
  struct AtBorder;
  struct Wall;
  struct Probe;
  struct Slots;
  struct Parts;
  struct NearSweeps;
  struct Displaced;
  // Four elements under way that are looked at as a whole.
  struct Look;
  // What a look needs to know of an element, four numbers at a time (mm, B).
  struct alignas(16) Shape {
    float x, y, z, sag;                 // how far its rim lies behind its tangent plane
    float lx, ly, lz, half_along;       // as of SurfaceElements
    float tx, ty, half_around, corner;  // corner: how far its corner is from its middle
  };

  void add_element(std::size_t i);
  void note_edges(const Bur& bur);
  ContactSet::Element point_of(std::size_t i, double around, double along, double share) const;
  void add_piece(std::size_t i, double around, double along, int across, int up, Pieces& to);

  double way_since(const Scan& scan, const Pose& pose) const noexcept;
  bool holds(const Scan& scan, double way) const noexcept;
  void begin(Scan& scan, const Pose& pose, double way) noexcept;
  void doubt_what_was_found(bool own) noexcept;
  void look_along_way(Scan& scan) noexcept;
  const StraightSweep* retraced_by(const Scan& scan, const Vec3& v) const noexcept;
  SweepHistory::Number leads_here(const Scan& scan) const noexcept;
  template <class Holds>
  static const StraightSweep* latest_part(const Scan& scan, const Holds& holds) noexcept;
  bool went_over(const Scan& scan, const Vec3& place) const noexcept;
  void advance(const Scan& scan) noexcept;
  int choose(const Scan& scan) noexcept;
  int add_advancing(const Scan& scan, int candidates) noexcept;
  void settle(const Scan& scan, int i) noexcept;
  void look(const Scan& scan, const std::int32_t* elements, int count) noexcept;
  void locate(const Scan& scan, Look& look) noexcept;
  bool floor_at_edge(const Scan& scan, int lane, const Look& look) const noexcept;
  Place corners(const Scan& scan, int lane, const Look& look) const noexcept;
  Float4 at_corners(const Scan& scan, const LevelSet& field, int lane,
                    const Look& look) const noexcept;
  Float4 taken_from(const Scan& scan, int lane, const Look& look, const Place& at) noexcept;
  bool corner_in_tissue(const Scan& scan, int lane, const Look& look) noexcept;
  bool corner_in_void(const Scan& scan, int lane, const Look& look) noexcept;
  bool ends_differ(const Scan& scan, int lane, const Look& look) const noexcept;
  bool has_edge_of_tooth(const Scan& scan, int lane, const Look& look) const noexcept;
  void look_farther(const Scan& scan, Look& look) noexcept;
  void look_for_tissue(const Scan& scan, int lane, Look& look) noexcept;
  void note_found(const Scan& scan, int lane, const Look& look) noexcept;
  float look_for_tissue(const Scan& scan, int i, const Index3& cell, const Eigen::Vector3f& at,
                        const Eigen::Vector3f& ahead, Standing& standing) noexcept;
  bool surely_advances(const Scan& scan, int i) const noexcept;
  void add_whole(const Scan& scan, int i, int tissue, float share) noexcept;
  void divide(const Scan& scan, int i) noexcept;
  void feed(const Scan& scan, const Pieces& pieces, int first, Lanes& lanes) const noexcept;
  void locate(const Scan& scan, const Pieces& pieces, int first, Lanes& lanes) const noexcept;
  void cover(const Scan& scan, const PieceAxes& axes, const Pieces& pieces, int first,
             KeptCells& farther, Lanes& lanes) const noexcept;
  static Int4 correct_where_it_meets(const Scan& scan, const CutOfPieces& cut, const Lanes& lanes,
                                     FourSamples& here) noexcept;
  static Float4 cover_here(const Scan& scan, const CutOfPieces& cut, Lanes& lanes) noexcept;
  void cover_ahead(const Scan& scan, const CutOfPieces& cut, const Float4& surface,
                   KeptCells& farther, Lanes& lanes) const noexcept;
  static Place ahead_of(const Scan& scan, const Lanes& lanes, const Float4& way,
                        const AlongWay* arc) noexcept;
  static FromPrint from_print(const Scan& scan, const CutOfPieces& cut,
                              const Lanes& lanes) noexcept;
  static AtBorder look_at_border(const Scan& scan, const CutOfPieces& cut, const Borders& borders,
                                 const Place& middle, const Int4& wanted) noexcept;
  static AtBorder look_at(const Scan& scan, const CutOfPieces& cut, const Float4& x,
                          const Float4& y, const Place& middle, const Int4& wanted) noexcept;
  void cover_by_far_walls(const Scan& scan, const CutOfPieces& cut, const Int4& may_count,
                          const Int4& lessened, Lanes& lanes) const noexcept;
  Int4 cover_by_slots(const Scan& scan, const CutOfPieces& cut, const Place& far,
                      const Float4& from_print, const Int4& wanted, Lanes& lanes) const noexcept;
  static void cover_by(const Slots& slots, const Int4& one, const Int4& two, Lanes& lanes) noexcept;
  const KnownSweep* known(const Scan& scan, SweepHistory::Number number) const noexcept;
  Float4 taken_by_sweeps(const Scan& scan, int element, const Place& at) noexcept;
  Int4 cover_by_sweeps(const Scan& scan, const CutOfPieces& cut, const Place& far,
                       const Int4& wanted, const Int4& lessened, Lanes& lanes) const noexcept;
  static Int4 cover_whole(const Int4& where, Lanes& lanes) noexcept;
  void cover_by_wall(const Scan& scan, const CutOfPieces& cut, const Place& far, const Int4& wanted,
                     Lanes& lanes) const noexcept;
  static Int4 cover_corners(const Scan& scan, const CutOfPieces& cut, const Place& far,
                            const Int4& wanted, Lanes& lanes) noexcept;
  static Int4 meet(const CutOfPieces& cut, const Probe& middle, const Probe& one,
                   const Probe& other, bool in_groove) noexcept;
  static Int4 reaches_here(const Scan& scan, const Place& far, const Float4& value, Int4 where,
                           const Lanes& s) noexcept;
  static Wall look_at_wall(const Scan& scan, const CutOfPieces& cut, const Displaced& at,
                           const Place& far, const Int4& wanted) noexcept;
  void cover_ridges(const Scan& scan, const CutOfPieces& cut, const FourSamples& there,
                    const Borders& border, const Place& far, const Int4& wanted,
                    Lanes& lanes) const noexcept;
  bool was_over(const Scan& scan, const CutOfPieces& cut, int p, float x, float y,
                const Lanes& lanes) const noexcept;
  static Int4 is_deeper(const Scan& scan, const CutOfPieces& cut, const Place& far,
                        const Displaced& beside, const Wall (&walls)[2],
                        const Int4& wanted) noexcept;
  void find_covered(const Scan& scan, int i, const Pieces& pieces, int first, bool simple,
                    Lanes& lanes) noexcept;
  void find_moved(int i, Lanes& lanes) noexcept;
  void keep_cut(const Scan& scan, int i, const Lanes& lanes) noexcept;
  void take_cut(int i, Lanes& lanes) const noexcept;
  static void move_on(float path, Lanes& lanes) noexcept;
  static bool are_told_by(const Int4& lines, const Lanes& lanes) noexcept;
  double farthest_of(const Scan& scan, const Lanes& lanes) const noexcept;
  double until(const Lanes& lanes, const Float4& way) const noexcept;
  void keep(int i, double farthest, const Lanes& lanes) noexcept;
  static void take_settled(const Standing& standing, Lanes& lanes) noexcept;
  void cover_advancing(const Pieces& pieces, int first, Lanes& lanes) const noexcept;
  void leave_out_where_it_was(const Scan& scan, const Pieces& pieces, int first,
                              Lanes& lanes) const noexcept;
  void cover_tooth(const Scan& scan, int i, const PieceAxes& axes, Lanes& lanes) noexcept;
  static void cover_both(const Int4& where, const CoveredPart<Float4>& by_cut,
                         Lanes& lanes) noexcept;
  static void share_tissues(const Scan& scan, const PieceAxes& axes, const Int4& counts,
                            const Int4& only, KeptTissues& kept, Lanes& lanes) noexcept;
  static ContactSet::FourElements middles(const Pieces& pieces, int first,
                                          const CoveredPart<Float4>& part,
                                          const Lanes& lanes) noexcept;
  void add_covered(const Pieces& pieces, int first, const Lanes& lanes) noexcept;
  void add_sums(const Scan& scan, const Standing& standing) noexcept;

  SurfaceElements elements_;
  ContactSet contact_;
  // Of each element: r x n, and by how much v·n changes over half of it per speed around and along.
  std::vector<float> mx_, my_, mz_, turn_around_, turn_along_;
  std::vector<float> edge_;  // which way along the profile a sharp edge lies at it: 1, -1, or 0
  WallCurvature walls_;
  const Bur& bur_;
  std::optional<SweptSlot> slot_;  // of a flat end
  bool leaves_slots_ = false;      // as the bur moves now
  bool has_edges_ = false;
  // Parts of the way, each in its number's place, as far as they were met.
  struct Known {
    SweepHistory::Number number = 0;
    std::uint64_t placed = 0;
    KnownSweep sweep;
  };
  static constexpr std::int32_t kKnown = 512;
  mutable std::vector<Known> known_;
  std::uint64_t sample_ = 0;  // number of the one under way
  std::vector<Shape> shapes_;
  std::vector<ContactSet::Sums> sums_;  // as a whole
  // The points that stand for it where it is engaged as a whole (two-point Gauss rule along each
  // curved direction), and its pieces, 2 x 2 or four side by side, for where it isn't.
  std::vector<std::int32_t> first_node_;  // and one past the last
  std::vector<ContactSet::Element> nodes_;
  Pieces squares_, strips_;

  // Of each element from sample to sample: what was found, and the way that it stands for, mm.
  std::vector<Found> found_;
  std::vector<Standing> standing_;
  std::vector<float> left_;
  std::vector<float> looked_x_, looked_y_, looked_z_;  // the direction looked in, unit, B
  // By how much farther it is, at least, to what may be met by an element that is in the void, mm.
  std::vector<float> slack_;
  // Until where on the way what was found to be covered of its pieces stands, mm.
  std::vector<double> settled_;
  std::vector<double> moves_;      // and until where its borders move on as they did
  std::vector<double> cut_moves_;  // likewise, of what the cut alone covers
  double way_ = 0;
  // The cells of the cut that were read last: of each element's middle, and of its pieces at the
  // surface and farther ahead.
  std::vector<KeptCell> cells_;
  std::vector<KeptCells> near_, far_;
  // Of the tooth's own fields: of each element's middle, and of its pieces.
  std::vector<KeptFields> fields_;
  std::vector<KeptTissues> tissues_;
  // Of a sample: v·n, half its range over the element, and 1 where it is worth a look.
  std::vector<float> advance_, range_;
  std::vector<std::int32_t> worth_, candidates_, to_look_;
  double look_ahead_, most_held_;  // mm
  double arm_;                     // mm, longest from the tip to a point of the head

  // Where the bur has been as well: from B now to B there.
  struct Been {
    Mat3 turn;
    Vec3 way;
  };
  std::vector<Been> been_;  // capacity reserved once

  Pose sampled_pose_;
  Vec3 sampled_direction_ = Vec3::Zero();
  double sampled_speed_ = 0;
  bool sampled_turning_ = false, sampled_ = false;
  std::uint64_t sampled_cuts_ = 0;
  double held_ = 0;  // mm of way for which the last sample stands
  // Where the way's curvature was last taken, the direction there, and that curvature, 1/mm; it isn't known before
  // the first of it. As a turn, rad/mm, W, and by how much that changed.
  double path_ = 0;  // of the tip, mm
  Vec3 position_ = Vec3::Zero();
  double step_ = 0;  // mm, the latest
  double bend_at_ = 0, bend_ = 1;
  Vec3 bend_direction_ = Vec3::Zero(), bend_axis_ = Vec3::UnitZ(), turning_ = Vec3::Zero();
  double swerve_ = 1, looked_along_ = -1;  // the latter as path_
};

// Area of the elements (of a shank, or a head) whose middle lies in tissue, mm², by the nearest voxel.
double area_in_tissue(const SurfaceElements& elements, const Workpiece& workpiece,
                      const Pose& pose) noexcept;

// The same from step to step. That a middle is in the void stands until the elements have moved by half
// of the way from the nearest voxel's value to 0: cuts only make void. A pose is given after another on
// the same workpiece.
class AreaInTissue {
 public:
  explicit AreaInTissue(const SurfaceElements& elements);  // keeps a reference
  double at(const Workpiece& workpiece, const Pose& pose) noexcept;

 private:
  const SurfaceElements& elements_;
  double arm_ = 0;  // mm, longest from the tip
  Pose looked_at_;  // last
  double way_ = 0;  // mm, so far
  // Until where on the way each is in the void for certain, those of a group are, and all of them are.
  static constexpr std::size_t kGroup = 16;  // elements
  std::vector<double> stands_, groups_stand_;
  double all_stand_ = 0;
};

}  // namespace toothprep
