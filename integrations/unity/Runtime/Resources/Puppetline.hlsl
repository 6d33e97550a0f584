// Blends the transforms of a frame of controls (docs/protocol.md). Inputs and results are in Unity's coordinates. The
// computation uses file coordinates, whose x axis has the opposite direction.

#ifndef PUPPETLINE_INCLUDED
#define PUPPETLINE_INCLUDED

// The rows of all characters, four numbers each. Every character has a block of 512 rows. The first row has the number of
// fields, the number of isolines per field, the index in the block of the first row of the shown pose, and that of the pose
// of the previous image. The three rows of a transform are multiplied by the weight of their field. With no fields,
// vertices are not changed; block 0 has none.
#if defined(SHADER_TARGET_SURFACE_ANALYSIS)
// Unity analyses surface shaders with a compiler that does not know buffers.
float4 PuppetlineRow(int row)
{
    return float4(0, 0, 0, 0);
}
#elif defined(SHADER_API_GLES3) || defined(SHADER_API_GLCORE)
// OpenGL ES 3.0 and WebGL 2 have no buffers in vertex shaders. A block is a row of texels.
Texture2D<float4> _PuppetlineTexture;

float4 PuppetlineRow(int row)
{
    return _PuppetlineTexture.Load(int3(row % 512, row / 512, 0));
}
#else
StructuredBuffer<float4> _PuppetlineTransforms;

float4 PuppetlineRow(int row)
{
    return _PuppetlineTransforms[row];
}
#endif

// The members of a vertex shader's input that blending needs.
#define PUPPETLINE_INPUTS \
    float3 positionOS : POSITION; \
    float3 normalOS : NORMAL; \
    float4 color : COLOR; \
    float2 uv : TEXCOORD0; \
    float2 block : TEXCOORD1; \
    float4 isolines0 : TEXCOORD2; \
    float4 isolines1 : TEXCOORD3; \
    float4 slopes0 : TEXCOORD4; \
    float4 slopes1 : TEXCOORD5; \
    float4 slopes2 : TEXCOORD6; \
    float4 slopes3 : TEXCOORD7;

// Set a PuppetlineRest from a vertex shader's input.
#define PUPPETLINE_REST(rest, input) \
    rest.position = input.positionOS; \
    rest.normal = input.normalOS; \
    rest.block = 512 * (int)input.block.x; \
    rest.isolines[0] = input.isolines0; \
    rest.isolines[1] = input.isolines1; \
    rest.slopes[0] = input.slopes0; \
    rest.slopes[1] = input.slopes1; \
    rest.slopes[2] = input.slopes2; \
    rest.slopes[3] = input.slopes3;

struct PuppetlineRest
{
    float3 position;
    float3 normal;
    int block;          // first row of the character's block
    float4 isolines[2]; // isoline coordinates
    float4 slopes[4];   // two per isoline coordinate
};

struct PuppetlinePoint
{
    float3 position;
    float3 normal;
};

float3 PuppetlineTurned(float3 v)
{
    return float3(-v.x, v.y, v.z);
}

// The normalised vector; zero for zero.
float3 PuppetlineUnit(float3 v)
{
    float squared = dot(v, v);
    return squared > 0 ? v * (1 / sqrt(squared)) : v;
}

// The first tangent of the slopes: normalise(e x n), where e is the axis with the smallest |n|.
float3 PuppetlineTangent(float3 n)
{
    float x = abs(n.x);
    float y = abs(n.y);
    float z = abs(n.z);
    float3 crossed = x <= y && x <= z ? float3(0, -n.z, n.y) : y <= z ? float3(n.z, 0, -n.x) : float3(-n.y, n.x, 0);
    return PuppetlineUnit(crossed);
}

// A pose of a character: the numbers of fields and isolines, and the first row of its transforms.
struct PuppetlinePose
{
    int fields;
    float isolines;
    int start;
};

// The shown pose, or the one of the previous image.
PuppetlinePose PuppetlinePoseOf(PuppetlineRest rest, bool before)
{
    float4 head = PuppetlineRow(rest.block);
    PuppetlinePose pose;
    pose.fields = (int)head.x;
    pose.isolines = head.y;
    pose.start = rest.block + (int)(before ? head.w : head.z);
    return pose;
}

// The isoline below an isoline coordinate. It is never the last isoline, so there is always one above it.
float PuppetlineLower(PuppetlinePose pose, float coordinate)
{
    return min(floor(coordinate), pose.isolines - 2);
}

// Index of the first row of a field's transform on an isoline.
int PuppetlineFirstRow(PuppetlinePose pose, int field, float isoline)
{
    return pose.start + 3 * (field * (int)pose.isolines + (int)isoline);
}

// Positions and exact normals of the surface.
PuppetlinePoint PuppetlineBySlopes(PuppetlineRest rest, PuppetlinePose pose)
{
    float3 x = PuppetlineTurned(rest.position);
    float3 n = PuppetlineTurned(rest.normal);
    float3 a = PuppetlineTangent(n);
    float3 b = cross(n, a);
    float4 at = float4(x.x, x.y, x.z, 1);
    float4 row0 = float4(0, 0, 0, 0);
    float4 row1 = row0;
    float4 row2 = row0;
    float3 along = float3(0, 0, 0);
    float3 across = along;
    for (int i = 0; i < 8; i++)
    {
        if (i < pose.fields)
        {
            float coordinate = rest.isolines[i / 4][i % 4];
            float lower = PuppetlineLower(pose, coordinate);
            int k = PuppetlineFirstRow(pose, i, lower);
            float share = coordinate - lower;
            float4 step0 = PuppetlineRow(k + 3) - PuppetlineRow(k);
            float4 step1 = PuppetlineRow(k + 4) - PuppetlineRow(k + 1);
            float4 step2 = PuppetlineRow(k + 5) - PuppetlineRow(k + 2);
            row0 = row0 + PuppetlineRow(k) + step0 * share;
            row1 = row1 + PuppetlineRow(k + 1) + step1 * share;
            row2 = row2 + PuppetlineRow(k + 2) + step2 * share;
            float3 moved = float3(dot(step0, at), dot(step1, at), dot(step2, at));
            along = along + moved * rest.slopes[i / 2][i % 2 * 2];
            across = across + moved * rest.slopes[i / 2][i % 2 * 2 + 1];
        }
    }
    float4 a4 = float4(a.x, a.y, a.z, 0);
    float4 b4 = float4(b.x, b.y, b.z, 0);
    along = along + float3(dot(row0, a4), dot(row1, a4), dot(row2, a4));
    across = across + float3(dot(row0, b4), dot(row1, b4), dot(row2, b4));
    PuppetlinePoint blended;
    blended.position = PuppetlineTurned(float3(dot(row0, at), dot(row1, at), dot(row2, at)));
    blended.normal = PuppetlineTurned(PuppetlineUnit(cross(along, across)));
    if (pose.fields < 1)
    {
        blended.position = rest.position;
        blended.normal = rest.normal;
    }
    return blended;
}

// Positions, and rest normals rotated by the blended transform. Slopes are not used.
PuppetlinePoint PuppetlineByCofactors(PuppetlineRest rest, PuppetlinePose pose)
{
    float3 x = PuppetlineTurned(rest.position);
    float3 n = PuppetlineTurned(rest.normal);
    float4 at = float4(x.x, x.y, x.z, 1);
    float4 row0 = float4(0, 0, 0, 0);
    float4 row1 = row0;
    float4 row2 = row0;
    for (int i = 0; i < 8; i++)
    {
        if (i < pose.fields)
        {
            float coordinate = rest.isolines[i / 4][i % 4];
            float lower = PuppetlineLower(pose, coordinate);
            int k = PuppetlineFirstRow(pose, i, lower);
            float share = coordinate - lower;
            row0 = row0 + PuppetlineRow(k) * (1 - share) + PuppetlineRow(k + 3) * share;
            row1 = row1 + PuppetlineRow(k + 1) * (1 - share) + PuppetlineRow(k + 4) * share;
            row2 = row2 + PuppetlineRow(k + 2) * (1 - share) + PuppetlineRow(k + 5) * share;
        }
    }
    float3 r0 = float3(row0.x, row0.y, row0.z);
    float3 r1 = float3(row1.x, row1.y, row1.z);
    float3 r2 = float3(row2.x, row2.y, row2.z);
    PuppetlinePoint blended;
    blended.position = PuppetlineTurned(float3(dot(row0, at), dot(row1, at), dot(row2, at)));
    // The rows of the cofactor matrix are the cross products of the rows of the matrix.
    blended.normal = PuppetlineTurned(PuppetlineUnit(float3(dot(cross(r1, r2), n), dot(cross(r2, r0), n), dot(cross(r0, r1), n))));
    if (pose.fields < 1)
    {
        blended.position = rest.position;
        blended.normal = rest.normal;
    }
    return blended;
}

// The position in the previous image, for motion vectors.
float3 PuppetlinePositionBefore(PuppetlineRest rest)
{
    return PuppetlineByCofactors(rest, PuppetlinePoseOf(rest, true)).position;
}

// The shown position and the exact normal.
PuppetlinePoint PuppetlineShown(PuppetlineRest rest)
{
    return PuppetlineBySlopes(rest, PuppetlinePoseOf(rest, false));
}

#endif
