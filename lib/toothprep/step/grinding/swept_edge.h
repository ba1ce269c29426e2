// What a bur's sharp edge cuts that is drawn along a straight way. Seen along the motion the edge's circle is an
// ellipse, and it stays one at every distance from the bur, since distances are mitred there (Bur::mitred_distances):
// the circle grows and moves along the axis. So the distance from what was swept is the root of a quadratic.
// In two dimensions across the motion, mm: l beside the bur's axis, h along it, from the middle of the edge's circle.
#pragma once

#include <algorithm>
#include <cmath>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

class SweptEdge {
 public:
  explicit SweptEdge(const SharpEdge& edge)
      : radius_(f(edge.after.r)),
        height_(f(edge.after.z)),
        normal_before_(f(-edge.before.along_r)),
        normal_after_(f(-edge.after.along_r)) {
    const ProfilePoint &b = edge.before, &a = edge.after;
    const double turn = b.along_r * a.along_z - b.along_z * a.along_r;
    out_r_ = f((b.along_r - a.along_r) / turn), out_z_ = f((b.along_z - a.along_z) / turn);
  }

  // Says how the bur moves: a unit vector, B. Square to the axis an edge draws nothing: its faces cut as deep.
  void move(const Vec3& along) noexcept {
    constexpr double kLeastLean = 3e-3;  // sine
    const double across = std::hypot(along.x(), along.y());
    draws_ = std::abs(along.z()) > kLeastLean;
    const Vec3 feed = across > kLeastLean ? Vec3(along / across) : Vec3::UnitX();
    beside_ = Vec3(feed.y(), -feed.x(), 0).cast<float>();
    axis_ = Vec3(-along.z() * feed.x(), -along.z() * feed.y(), across).cast<float>();
    lean_ = f(along.z() * along.z()), across_ = f(across);
    if (!draws_) return;
    per_height_ = f(1 / along.z());
    square_ = out_z_ * out_z_ * across_ * across_ - lean_ * out_r_ * out_r_;
    lowest_ = Angle(normal_before_, across_), highest_ = Angle(normal_after_, across_);
  }
  bool draws() const { return draws_; }

  struct Place {  // or a vector
    Float4 l, h;
    friend Place operator+(const Place& a, const Place& b) { return {a.l + b.l, a.h + b.h}; }
    friend Place operator-(const Place& a, const Place& b) { return {a.l - b.l, a.h - b.h}; }
    friend Place operator*(const Float4& a, const Place& b) { return {a * b.l, a * b.h}; }
  };
  // Of a vector in B.
  Place across(const Float4& x, const Float4& y, const Float4& z) const {
    return {beside_.x() * x + beside_.y() * y, axis_.x() * x + axis_.y() * y + axis_.z() * z};
  }

  struct Sample {
    Float4 distance;  // mm, outside of what the edge swept
    Place gradient;
    Int4 counts;  // -1: there is nothing nearer; 0: one of the edge's faces is
  };
  Sample at(const Place& p) const {
    const Float4 b = -lean_ * out_r_ * radius_ - out_z_ * across_ * p.h,
                 c = lean_ * (p.l * p.l - radius_ * radius_) + p.h * p.h,
                 rest = b * b - square_ * c, root = square_root(greatest(rest, all4(kLeastRoot)));
    // That of the ellipse on which the place lies.
    const Float4 d = (b < 0 ? c : -(b + root)) / (b < 0 ? root - b : all4(square_));
    const Place g{lean_ * p.l / root, (p.h - out_z_ * across_ * d) / root};
    const Int4 has_circle = (rest > kLeastRoot) & (radius_ + out_r_ * d > 0);
    return {d, g, has_circle & (lowest_.over(g) >= 0) & (highest_.over(g) <= 0)};
  }
  // Where the bur is (mm on its way, from now) as its edge comes nearest to a place so far outside, at height z over
  // the tip now.
  Float4 way_to(const Float4& z, const Float4& distance) const {
    return (z - height_ - out_z_ * distance) * per_height_;
  }
  // The place of the ellipse at a distance at which it has this unit normal.
  Place contact(const Float4& distance, const Place& normal) const {
    const Float4 radius = (radius_ + out_r_ * distance) / reach_of_one(normal);
    return {radius * normal.l, radius * lean_ * normal.h + out_z_ * across_ * distance};
  }
  // How far out the ellipse at distance 0 reaches along a unit normal, how much less it reaches as the normal turns
  // from l towards h, per angle, and the ellipse's radius of curvature there. mm
  Float4 reach(const Place& normal) const { return radius_ * reach_of_one(normal); }
  Float4 slope(const Place& normal) const {
    return radius_ * (1 - lean_) * normal.l * normal.h / reach_of_one(normal);
  }
  Float4 bend(const Place& normal) const {
    const Float4 reach = reach_of_one(normal);
    return radius_ * lean_ / (reach * reach * reach);
  }

  float radius() const { return radius_; }  // mm
  float height() const { return height_; }  // mm, over the tip
  // Of the normal of the face behind it, its part along the axis; and of the motion, that across the axis.
  float normal_after() const { return normal_after_; }
  float across() const { return across_; }
  float lean() const { return std::sqrt(lean_); }  // sine, of the motion from square to the axis

 private:
  static constexpr float kLeastRoot = 1e-12f;
  static float f(double x) { return static_cast<float>(x); }

  // Of a circle of 1 mm.
  Float4 reach_of_one(const Place& normal) const {
    const Float4 square = normal.l * normal.l + lean_ * normal.h * normal.h;
    return greatest(square_root(square), all4(kLeastRoot));
  }

  // Of a normal across the motion, from l on towards h.
  struct Angle {
    float sine = 0, cosine = 1;
    Angle() = default;
    // By the normal's part along the bur's axis.
    Angle(float normal, float across)
        : sine(std::clamp(normal / std::max(across, kLeastRoot), -1.0f, 1.0f)),
          cosine(std::sqrt(1 - sine * sine)) {}
    // Positive for a vector that rises more.
    Float4 over(const Place& g) const { return cosine * g.h - sine * magnitude(g.l); }
  };

  float radius_, height_;
  float normal_before_, normal_after_;  // of its faces, their part along the axis
  float out_r_ = 0, out_z_ = 0;         // by how much the circle grows and rises per distance
  bool draws_ = false;
  float lean_ = 0, across_ = 1;  // of the motion: its part along the axis squared, and that across
  float per_height_ = 0, square_ = 1;
  Angle lowest_, highest_;  // normals at which the edge is nearest
  Eigen::Vector3f beside_, axis_;
};

}  // namespace toothprep
