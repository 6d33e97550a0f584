// Stand-ins for the vectors and functions of HLSL that Puppetline.hlsl uses, and the shader compiled as C++ with them. The
// program reads shape, rows, number of vertices and the vertex streams, and writes the points of both functions.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

using std::abs;
using std::floor;
using std::min;
using std::sqrt;

struct float3
{
    float x, y, z;
    float3() = default;
    float3(float x, float y, float z) : x(x), y(y), z(z) {}
};

struct float4
{
    float x, y, z, w;
    float4() = default;
    float4(float x, float y, float z, float w) : x(x), y(y), z(z), w(w) {}
    float operator[](int i) const { return i == 0 ? x : i == 1 ? y : i == 2 ? z : w; }
};

static float3 operator+(float3 a, float3 b) { return float3(a.x + b.x, a.y + b.y, a.z + b.z); }
static float3 operator*(float3 a, float s) { return float3(a.x * s, a.y * s, a.z * s); }
static float4 operator+(float4 a, float4 b) { return float4(a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w); }
static float4 operator-(float4 a, float4 b) { return float4(a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w); }
static float4 operator*(float4 a, float s) { return float4(a.x * s, a.y * s, a.z * s, a.w * s); }
static float dot(float3 a, float3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static float dot(float4 a, float4 b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }
static float3 cross(float3 a, float3 b) { return float3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x); }

#include "Puppetline.hlsl"

template <typename T> static std::vector<T> read(size_t count)
{
    std::vector<T> values(count);
    if (fread(values.data(), sizeof(T), count, stdin) != count)
    {
        exit(1);
    }
    return values;
}

int main()
{
    _PuppetlineShape = read<float4>(1)[0];
    std::vector<float4> rows = read<float4>(240);
    std::copy(rows.begin(), rows.end(), _PuppetlineTransforms);
    int n = read<int>(1)[0];
    std::vector<float3> moving = read<float3>(2 * n);
    std::vector<float4> ladder = read<float4>(6 * n);
    for (int v = 0; v < n; v++)
    {
        PuppetlineRest rest;
        rest.position = moving[2 * v];
        rest.normal = moving[2 * v + 1];
        std::copy_n(&ladder[6 * v], 2, rest.ladder);
        std::copy_n(&ladder[6 * v + 2], 4, rest.slopes);
        PuppetlinePoint points[] = {PuppetlineBySlopes(rest), PuppetlineByCofactors(rest)};
        fwrite(points, sizeof(points), 1, stdout);
    }
}
