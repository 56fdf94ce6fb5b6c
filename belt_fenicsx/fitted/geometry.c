/* Chords of cells as seen from the centres of their pulleys: see geometry.py.

   The data of a cell are a row: the deviations of its nodes from the chord, then, from `chord` on, the names of
   `forms.CHORD` in their order. Points are two numbers. */

#include <math.h>

enum { X, Y, ALONG_X, ALONG_Y, EXCESS_LEFT, EXCESS_RIGHT, COS, SIN, Q1, Q2, LENGTH, BULGE_X, BULGE_Y, FLAT, SKEW };

/* Computes what the forms need to know of a chord: small differences of large numbers. A long double has eleven bits
   more than a double on x86, and never fewer. */
void measure(int cells, int stride, double *row, int chord, int length, const double *radius, const double *frame)
{
  for (int cell = 0; cell < cells; ++cell, row += stride)
  {
    double *data = row + chord;
    const long double x = data[X], y = data[Y], along_x = data[ALONG_X], along_y = data[ALONG_Y];
    const long double right_x = x + along_x, right_y = y + along_y;
    const long double square = (long double)radius[cell] * radius[cell], size = row[length];
    const long double cos = cosl(frame[cell]), sin = sinl(frame[cell]);
    const long double bulge_x = data[BULGE_X], bulge_y = data[BULGE_Y];
    data[EXCESS_LEFT] = square - (x * x + y * y);
    data[EXCESS_RIGHT] = square - (right_x * right_x + right_y * right_y);
    data[COS] = cos;
    data[SIN] = sin;
    data[Q1] = (along_x * cos + along_y * sin) / size - 1.0L;
    data[Q2] = (along_y * cos - along_x * sin) / size;
    data[LENGTH] = size;
    data[FLAT] = along_x * along_x + along_y * along_y - 2.0L * (bulge_x * x + bulge_y * y);
    data[SKEW] = bulge_x * along_x + bulge_y * along_y;
  }
}

/* What `sum`, the floating-point sum of a and b, is less than the exact one; itself exact.

   D. E. Knuth, "The Art of Computer Programming", volume 2, section 4.2.2. */
static double sum_error(double a, double b, double sum)
{
  const double of_b = sum - a;
  return (a - (sum - of_b)) + (b - of_b);
}

/* Shifts nodes by `way`; what sums lose by rounding is kept in the deviation. Nodes are at the places `at` of the unit
   cell, the left one and the right one first; the centre of the pulley moves by `center`. */
void shift(int cells, int nodes, int stride, double *row, int chord, const double *at, const double *way,
           const double *center)
{
  for (int cell = 0; cell < cells; ++cell, row += stride, way += 2 * nodes, center += 2)
    for (int axis = 0; axis < 2; ++axis)
    {
      double *left = row + chord + X + axis, *along = row + chord + ALONG_X + axis, *deviation = row + axis;
      const double of_left = way[axis] - center[axis], of_right = way[2 + axis], of_along = of_right - way[axis];
      const double moved = *left + of_left, turned = *along + of_along;
      const double lost = sum_error(*left, of_left, moved), lost_along = sum_error(*along, of_along, turned);
      deviation[0] += lost;
      deviation[2] += sum_error(of_right, -way[axis], of_along) + (lost + lost_along);
      for (int node = 2; node < nodes; ++node)
        deviation[2 * node] += way[2 * node + axis] - way[axis] - of_along * at[node] + (lost + at[node] * lost_along);
      *left = moved;
      *along = turned;
    }
}
