/* Gaussian elimination of many small dense blocks, one after another. See elimination.py.

   Each of the m members of a group has w unknowns, of which the first h are eliminated, and w equations, with the
   right-hand side behind their coefficients: a row has w + 1 numbers. */

#include <math.h>
#include <stdint.h>

/* Compiled for two kinds of processors, of which the loader takes the one at hand: wide registers save a third of the
   time. Both round alike, as none of them adds and multiplies in one step. */
#if defined(__GLIBC__) && defined(__x86_64__) && !defined(__clang__)
#define FOR_WIDE_REGISTERS __attribute__((target_clones("avx2", "default")))
#else
#define FOR_WIDE_REGISTERS
#endif

/* Eliminates what is hidden from the rows of each member, and adds what is left to the next level's entries.

   The hidden unknowns come in blocks that end at `ends`; an equation of a block is exchanged with another one of the
   same block, where that has the largest coefficient. Returns 1 where all of these are zero, else 0. */
FOR_WIDE_REGISTERS
int eliminate(int members, int h, int w, const int32_t *block, const int32_t *ends, const double *entries, double *rows,
              const int32_t *places, double *next)
{
  const int width = w + 1, left = w - h;
  for (int member = 0; member < members; ++member)
  {
    for (int i = 0; i < w * width; ++i)
      rows[i] = entries[block[i]];
    for (int i = 0, end = *ends, index = 0; i < h; ++i)
    {
      if (i == end)
        end = ends[++index];
      int largest = i;
      for (int other = i + 1; other < end; ++other)
        if (fabs(rows[other * width + i]) > fabs(rows[largest * width + i]))
          largest = other;
      double *pivot = rows + i * width, *exchanged = rows + largest * width;
      for (int k = i; k < width && largest != i; ++k)
      {
        const double value = pivot[k];
        pivot[k] = exchanged[k];
        exchanged[k] = value;
      }
      if (pivot[i] == 0.0)
        return 1;
      for (int other = i + 1; other < w; ++other)
      {
        double *restrict row = rows + other * width;
        const double factor = row[i] / pivot[i];
        /* Many are zero: blocks know nothing of some that come before, pairs little of each other's cells. */
        if (factor != 0.0)
          for (int k = i + 1; k < width; ++k)
            row[k] -= factor * pivot[k];
      }
    }
    for (int i = 0; i < left; ++i)
      for (int k = 0; k <= left; ++k)
        next[*places++] += rows[(h + i) * width + h + k];
    rows += w * width;
    block += w * width;
  }
  return 0;
}

/* Puts what was hidden among the unknowns, from what is known already of those that were left. */
void substitute(int members, int h, int w, const double *rows, const int32_t *hidden, const int32_t *left,
                double *unknowns)
{
  const int width = w + 1;
  for (int member = 0; member < members; ++member)
  {
    for (int i = h - 1; i >= 0; --i)
    {
      const double *row = rows + i * width;
      double sum = row[w];
      for (int k = i + 1; k < h; ++k)
        sum += row[k] * unknowns[hidden[k]];
      for (int k = h; k < w; ++k)
        sum += row[k] * unknowns[left[k - h]];
      unknowns[hidden[i]] = -sum / row[i];
    }
    rows += w * width;
    hidden += h;
    left += w - h;
  }
}
