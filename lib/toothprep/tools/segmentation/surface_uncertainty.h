// How far each surface of a tooth from a scan could lie from where it was found: 95 % half widths.
//
// A surface is where the grey passes a border; what changes the grey by dg moves it by dg / |grad g|.
// Three independent parts, at each place of a surface:
//
//   h^2 = (1.96 n / |grad g|)^2 + (1.96 c / |grad g|)^2 + (k s)^2
//
//   n  noise's standard deviation, of the greys that were thresholded (smoothed where they were)
//   c  of the border's grey: half of how dentin's and enamel's typical greys vary in the tooth beyond
//      its noise (beam hardening, mineralization), as root of the sum of squares
//   s  voxel of the scan, or of the tooth if that is coarser; k = 0.2 (outside), 0.4 (pulp,
//      with its thin canals) and 0.3 (others) for what voxels, interpolation and curvature do, found on synthetic scans without noise
//
// Enamel whose thickness was fitted (thin_enamel.h) has its border to within a third of a voxel
// besides. A half width is at most two voxels of the scan: where the grey has no slope, there is no
// surface to be known. Shadows and streaks beside metal aren't covered.
#pragma once

#include "toothprep/tools/io/scan_uncertainty.h"
#include "toothprep/tools/segmentation/grey_classes.h"
#include "toothprep/tools/segmentation/thin_enamel.h"
#include "toothprep/tools/segmentation/tooth_fields.h"

namespace toothprep {

// `grey`: what was thresholded, with noise of that standard deviation. Lengths in voxels of the box;
// `blur` as elsewhere here.
SurfaceUncertainty surface_uncertainty(const WorkBox& box, const TrimmedField& grey, double noise,
                                       const ToothFields& fields, const GreyClasses& classes,
                                       const ThinEnamel& thin, double blur);

}  // namespace toothprep
