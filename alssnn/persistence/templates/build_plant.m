function build_$prefix()
% Build a diagram of Simulink, plant_simulink, with the block Model from u to y,
#if CONTROL
% the block Controller from r$law_d and y to u, and their loop.
#else
% identified by alssnn $version.
#endif
#if HOLDS
% u is held for a sample; in the record it went on as $between.
#endif
% Both compute at every sample. This folder must be on the path of MATLAB.
top = 'plant_simulink';
new_system(top);
dt = '$dt';

add_block('built-in/Subsystem', [top '/Model']);
in = [top '/Model'];
add_block('built-in/Inport', [in '/u']);
add_block('built-in/ZeroOrderHold', [in '/hold u'], 'SampleTime', dt);
add_block('built-in/UnitDelay', [in '/x'], 'SampleTime', dt, ...
    'InitialCondition', 'zeros($nstate, 1)');
add_block('built-in/Mux', [in '/x and u'], 'Inputs', '[$nstate $nu]');
add_block('built-in/MATLABFcn', [in '/step'], 'MATLABFcn', 'plant_step(u)', ...
    'OutputDimensions', '$nstate');
add_block('built-in/MATLABFcn', [in '/respond'], 'MATLABFcn', 'plant_respond(u)', ...
    'OutputDimensions', '$ny');
add_block('built-in/Outport', [in '/y']);
add_line(in, 'u/1', 'hold u/1');
add_line(in, 'x/1', 'x and u/1');
add_line(in, 'hold u/1', 'x and u/2');
add_line(in, 'x and u/1', 'step/1');
add_line(in, 'step/1', 'x/1');
#if FEEDS
add_line(in, 'x and u/1', 'respond/1');
#else
add_line(in, 'x/1', 'respond/1');
#endif
add_line(in, 'respond/1', 'y/1');
#if CONTROL

add_block('built-in/Subsystem', [top '/Controller']);
in = [top '/Controller'];
signals = {$controller_inputs};
add_block('built-in/UnitDelay', [in '/w'], 'SampleTime', dt, ...
    'InitialCondition', 'zeros($nw, 1)');
add_block('built-in/Mux', [in '/all'], 'Inputs', '[$controller_sizes]');
add_line(in, 'w/1', 'all/1');
for i = 1:numel(signals)
    name = signals{i};
    add_block('built-in/Inport', [in '/' name]);
    add_block('built-in/ZeroOrderHold', [in '/hold ' name], 'SampleTime', dt);
    add_line(in, [name '/1'], ['hold ' name '/1']);
    add_line(in, ['hold ' name '/1'], sprintf('all/%d', i + 1));
end
add_block('built-in/MATLABFcn', [in '/control'], 'MATLABFcn', 'plant_control(u)', ...
    'OutputDimensions', '$ncontrolled');
add_block('built-in/Demux', [in '/u and w'], 'Outputs', '[$nv $nw]');
add_block('built-in/Outport', [in '/u']);
add_line(in, 'all/1', 'control/1');
add_line(in, 'control/1', 'u and w/1');
add_line(in, 'u and w/1', 'u/1');
add_line(in, 'u and w/2', 'w/1');

add_block('built-in/Inport', [top '/r']);
add_line(top, 'r/1', 'Controller/1');
add_line(top, 'Model/1', 'Controller/2');
#if DISTURBED
add_block('built-in/Inport', [top '/d']);
add_line(top, 'd/1', 'Controller/3');
add_block('built-in/Mux', [top '/u and d'], 'Inputs', '[$nv $nd]');
add_block('built-in/Selector', [top '/every'], 'Indices', '[$order]', ...
    'InputPortWidth', '$nu');
add_line(top, 'Controller/1', 'u and d/1');
add_line(top, 'd/1', 'u and d/2');
add_line(top, 'u and d/1', 'every/1');
add_line(top, 'every/1', 'Model/1');
#else
add_line(top, 'Controller/1', 'Model/1');
#endif
add_block('built-in/Outport', [top '/y']);
add_block('built-in/Outport', [top '/u']);
add_line(top, 'Model/1', 'y/1');
add_line(top, 'Controller/1', 'u/1');
#else
add_block('built-in/Inport', [top '/u']);
add_block('built-in/Outport', [top '/y']);
add_line(top, 'u/1', 'Model/1');
add_line(top, 'Model/1', 'y/1');
#endif
open_system(top);
end
