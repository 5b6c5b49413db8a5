function model = plant_data()
% Return the struct of plant.mat, which is read once.
persistent kept
if isempty(kept)
    kept = load(fullfile(fileparts(mfilename('fullpath')), 'plant.mat'));
end
model = kept.model;
end
