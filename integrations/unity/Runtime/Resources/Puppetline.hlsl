// Blends the transforms of a frame of controls (docs/protocol.md). Inputs and results are in Unity's coordinates. The
// computation uses file coordinates, whose x axis has the opposite direction.

#ifndef PUPPETLINE_INCLUDED
#define PUPPETLINE_INCLUDED

// Rows of the transforms, multiplied by the weight of their field; at most 80 transforms.
float4 _PuppetlineTransforms[240];

// Number of fields, and number of isolines per field. With no fields, vertices are not changed.
float4 _PuppetlineShape;

struct PuppetlineRest
{
    float3 position;
    float3 normal;
    float4 ladder[2]; // isoline coordinates, TEXCOORD2 and 3
    float4 slopes[4]; // TEXCOORD4 to 7: two per isoline coordinate
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

// Index of the first row of a field's lower transform for an isoline coordinate.
int PuppetlineRow(int field, float coordinate)
{
    return 3 * (field * (int)_PuppetlineShape.y + (int)min(floor(coordinate), _PuppetlineShape.y - 2));
}

// Positions and exact normals of the surface.
PuppetlinePoint PuppetlineBySlopes(PuppetlineRest rest)
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
        if (i < (int)_PuppetlineShape.x)
        {
            float coordinate = rest.ladder[i / 4][i % 4];
            int k = PuppetlineRow(i, coordinate);
            float share = coordinate - min(floor(coordinate), _PuppetlineShape.y - 2);
            float4 step0 = _PuppetlineTransforms[k + 3] - _PuppetlineTransforms[k];
            float4 step1 = _PuppetlineTransforms[k + 4] - _PuppetlineTransforms[k + 1];
            float4 step2 = _PuppetlineTransforms[k + 5] - _PuppetlineTransforms[k + 2];
            row0 = row0 + _PuppetlineTransforms[k] + step0 * share;
            row1 = row1 + _PuppetlineTransforms[k + 1] + step1 * share;
            row2 = row2 + _PuppetlineTransforms[k + 2] + step2 * share;
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
    if (_PuppetlineShape.x < 1)
    {
        blended.position = rest.position;
        blended.normal = rest.normal;
    }
    return blended;
}

// Positions, and rest normals rotated by the blended transform. Slopes are not used.
PuppetlinePoint PuppetlineByCofactors(PuppetlineRest rest)
{
    float3 x = PuppetlineTurned(rest.position);
    float3 n = PuppetlineTurned(rest.normal);
    float4 at = float4(x.x, x.y, x.z, 1);
    float4 row0 = float4(0, 0, 0, 0);
    float4 row1 = row0;
    float4 row2 = row0;
    for (int i = 0; i < 8; i++)
    {
        if (i < (int)_PuppetlineShape.x)
        {
            float coordinate = rest.ladder[i / 4][i % 4];
            int k = PuppetlineRow(i, coordinate);
            float share = coordinate - min(floor(coordinate), _PuppetlineShape.y - 2);
            row0 = row0 + _PuppetlineTransforms[k] * (1 - share) + _PuppetlineTransforms[k + 3] * share;
            row1 = row1 + _PuppetlineTransforms[k + 1] * (1 - share) + _PuppetlineTransforms[k + 4] * share;
            row2 = row2 + _PuppetlineTransforms[k + 2] * (1 - share) + _PuppetlineTransforms[k + 5] * share;
        }
    }
    float3 r0 = float3(row0.x, row0.y, row0.z);
    float3 r1 = float3(row1.x, row1.y, row1.z);
    float3 r2 = float3(row2.x, row2.y, row2.z);
    PuppetlinePoint blended;
    blended.position = PuppetlineTurned(float3(dot(row0, at), dot(row1, at), dot(row2, at)));
    // The rows of the cofactor matrix are the cross products of the rows of the matrix.
    blended.normal = PuppetlineTurned(PuppetlineUnit(float3(dot(cross(r1, r2), n), dot(cross(r2, r0), n), dot(cross(r0, r1), n))));
    if (_PuppetlineShape.x < 1)
    {
        blended.position = rest.position;
        blended.normal = rest.normal;
    }
    return blended;
}

#endif
