// A vertex shader whose results a test reads back.

#include "Puppetline.hlsl"

struct Inputs
{
    PUPPETLINE_INPUTS
};

struct Outputs
{
    float4 place : SV_Position;
    float3 position : TEXCOORD0;
    float3 normal : TEXCOORD1;
    float3 before : TEXCOORD2;
};

Outputs main(Inputs input)
{
    PuppetlineRest rest;
    PUPPETLINE_REST(rest, input)
    PuppetlinePoint shown = PuppetlineShown(rest);
    Outputs output;
    output.place = float4(input.color.x + input.uv.x, 0, 0, 1);
    output.position = shown.position;
    output.normal = shown.normal;
    output.before = PuppetlinePositionBefore(rest);
    return output;
}
