// The surface shader of the built-in pipeline, with the lighting of the Standard shader.

#ifndef PUPPETLINE_BUILT_IN_INCLUDED
#define PUPPETLINE_BUILT_IN_INCLUDED

#include "Puppetline.hlsl"

// Unity's surface shaders require these names.
struct appdata
{
    float4 vertex : POSITION;
    float3 normal : NORMAL;
    float4 color : COLOR;
    float4 texcoord : TEXCOORD0;
    float4 texcoord1 : TEXCOORD1;
    float4 isolines0 : TEXCOORD2;
    float4 isolines1 : TEXCOORD3;
    float4 slopes0 : TEXCOORD4;
    float4 slopes1 : TEXCOORD5;
    float4 slopes2 : TEXCOORD6;
    float4 slopes3 : TEXCOORD7;
    UNITY_VERTEX_INPUT_INSTANCE_ID
};

struct Input
{
    float2 uv_BaseMap;
    float4 color : COLOR;
};

sampler2D _BaseMap, _EmissionMap;
float4 _BaseColor, _EmissionColor;
float _Metallic, _Smoothness, _VertexColors, _Cutoff;

void PuppetlineVertex(inout appdata v)
{
    PuppetlineRest rest;
    rest.position = v.vertex.xyz;
    rest.normal = v.normal;
    rest.block = 512 * (int)v.texcoord1.x;
    rest.isolines[0] = v.isolines0;
    rest.isolines[1] = v.isolines1;
    rest.slopes[0] = v.slopes0;
    rest.slopes[1] = v.slopes1;
    rest.slopes[2] = v.slopes2;
    rest.slopes[3] = v.slopes3;
    PuppetlinePoint shown = PuppetlineShown(rest);
    v.vertex.xyz = shown.position;
    v.normal = shown.normal;
}

void PuppetlineSurface(Input input, inout SurfaceOutputStandard o)
{
    float4 base = tex2D(_BaseMap, input.uv_BaseMap) * _BaseColor;
#if defined(_ALPHATEST_ON)
    clip(base.a - _Cutoff);
#endif
    o.Albedo = base.rgb * lerp(float3(1, 1, 1), input.color.rgb, _VertexColors);
    o.Alpha = base.a;
    o.Emission = tex2D(_EmissionMap, input.uv_BaseMap).rgb * _EmissionColor.rgb;
    o.Metallic = _Metallic;
    o.Smoothness = _Smoothness;
}

#endif
