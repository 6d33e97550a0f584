// Stand-ins for the vectors and functions of HLSL that Puppetline.hlsl uses, and the shader compiled as C++ with them. The
// program reads the number of rows, the rows, the number of vertices and the vertex streams. It writes the points of both
// functions for the shown pose, and the positions of the pose before.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
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

template <typename T> struct StructuredBuffer : std::vector<T>
{
};

struct int3
{
    int x, y;
    int3(int x, int y, int) : x(x), y(y) {}
};

template <typename T> struct Texture2D : std::vector<T>
{
    T Load(int3 place) const { return (*this)[512 * place.y + place.x]; }
};

#include "Puppetline.hlsl"

#if defined(SHADER_API_GLES3)
static std::vector<float4> &rows = _PuppetlineTexture;
#else
static std::vector<float4> &rows = _PuppetlineTransforms;
#endif

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
    rows = read<float4>(read<int>(1)[0]);
    int n = read<int>(1)[0];
    std::vector<float3> moving = read<float3>(2 * n);
    std::vector<float> constant = read<float>(26 * n);
    for (int v = 0; v < n; v++)
    {
        const float *at = &constant[26 * v];
        PuppetlineRest rest;
        rest.position = moving[2 * v];
        rest.normal = moving[2 * v + 1];
        rest.block = 512 * (int)at[0];
        memcpy(rest.isolines, at + 2, sizeof(rest.isolines));
        memcpy(rest.slopes, at + 10, sizeof(rest.slopes));
        PuppetlinePoint points[] = {PuppetlineShown(rest), PuppetlineByCofactors(rest, PuppetlinePoseOf(rest, false))};
        float3 before = PuppetlinePositionBefore(rest);
        fwrite(points, sizeof(points), 1, stdout);
        fwrite(&before, sizeof(before), 1, stdout);
    }
}
