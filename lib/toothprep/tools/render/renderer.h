// Draws surfaces with parallel rays: shaded colours, and depth, normal, tissue, deviation.
//
// Light stands still before the camera: a soft key light from the upper left (its shadow is that of
// a lamp 14° wide), a fill light from the right, and an even sky that each place sees as far as its
// surroundings let it (ambient occlusion within a reach, weaker with distance), brightened by what
// pale walls throw back onto each other. Cavities are readable by the last.
//
// Every pixel is a pure function of the scene, the camera and its own coordinates: the same bits
// whatever the number of threads.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "toothprep/tools/render/image.h"
#include "toothprep/tools/render/part.h"
#include "toothprep/tools/render/view.h"

namespace toothprep {

struct RenderOptions {       // of one picture
  int samples = 4;           // colours are averaged over samples x samples per pixel; 1 to 16
  int ambient_rays = 96;     // per pixel
  double ambient_reach = 0;  // mm; 0: 0.3 of the scene's radius
  double range = 0.3;        // mm: the deviation at which the colours end
  // Everything in front of it is removed; the face is closed and shows the tissue (of parts with a
  // tooth; else one colour). A part is taken as closed where the ray first leaves it, so an open
  // shell may show a face that isn't there.
  std::optional<CutPlane> cut = std::nullopt;
  // Called now and then with the share of the picture that is done, from several threads; what it
  // throws ends the drawing.
  std::function<void(double done)> progress = {};
};

class Renderer {  // a scene; renders any number of pictures
 public:
  // Throws Error for parts without triangles, with a wrong number of tissues or deviations, with
  // coordinates that are not finite.
  explicit Renderer(std::vector<RenderPart> parts);
  ~Renderer();                    // parts go with it
  Renderer(Renderer&&) noexcept;  // what is left behind is empty

  std::vector<const TriangleMesh*> meshes() const;  // for fit_camera
  [[nodiscard]] Vec3 middle() const;                // of the meshes' box, mm, W

  // Throws Error for options out of range.
  Image render(const Camera& camera, const RenderOptions& options = {}) const;

 private:
  struct Part;
  struct Pass;
  std::vector<Part> parts_;
  Vec3 low_ = Vec3::Zero(), high_ = Vec3::Zero();
};

}  // namespace toothprep
